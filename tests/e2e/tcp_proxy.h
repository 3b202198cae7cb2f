// A network between a program and a coordinator that a test can spoil.
#ifndef TESSERA_TESTS_E2E_TCP_PROXY_H_
#define TESSERA_TESTS_E2E_TCP_PROXY_H_

#include <atomic>
#include <chrono>
#include <deque>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace tessera::e2e {

// Hands connections to a port of loopback on to another, by a thread of its own. Thread-safe.
class TcpProxy {
 public:
  enum class Mode {
    kPass,
    kStall,  // connections stay, and are accepted, but nothing comes through: a cable that was pulled
    kCut,    // connections are reset, new ones too: a peer that went
  };

  // `target`: "127.0.0.1:PORT".
  explicit TcpProxy(const std::string& target);
  ~TcpProxy();

  // "127.0.0.1:PORT".
  const std::string& address() const { return address_; }
  void Set(Mode mode) { mode_ = mode; }
  // Every byte comes so much later, whichever way it goes.
  void SetDelay(double seconds) { delay_s_ = seconds; }
  // Resets the connections that are there now, once.
  void Drop() { drop_ = true; }
  // Connections that were made, and those that were made while they were cut.
  int accepted() const { return accepted_; }
  int refused() const { return refused_; }

 private:
  using Time = std::chrono::steady_clock::time_point;
  struct Chunk {
    Time due;
    std::string bytes;
  };
  // One way of a connection.
  struct Way {
    int from = -1, to = -1;
    std::deque<Chunk> chunks;
    size_t waiting_bytes = 0;
    bool ended = false;  // `from` has no more
    bool told = false;   // and `to` knows
  };
  struct Connection {
    Way there, back;
  };

  void Run();
  void Accept();
  bool Carry(Way& way);  // false if the connection broke
  static void Reset(const Connection& connection);

  std::string address_;
  int target_port_ = 0, listener_ = -1;
  std::atomic<Mode> mode_ = Mode::kPass;
  std::atomic<double> delay_s_ = 0;
  std::atomic<bool> drop_ = false, stop_ = false;
  std::atomic<int> accepted_ = 0, refused_ = 0;
  std::vector<std::unique_ptr<Connection>> connections_;  // of the thread
  std::thread thread_;
};

}  // namespace tessera::e2e

#endif  // TESSERA_TESTS_E2E_TCP_PROXY_H_
