// A TCP proxy between a program and a coordinator that can delay, stall and reset connections.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace tessera::e2e {

// Forwards connections from one loopback port to another, in its own thread. Thread-safe.
class TcpProxy {
 public:
  enum class Mode {
    kPass,
    kStall,      // connections stay open and are accepted, but no data is forwarded: like an unplugged cable
    kCut,        // connections, also new ones, are reset: like a dead peer
    kNoAnswers,  // what the program sends is forwarded, what it would receive is not
  };

  // `target`: "127.0.0.1:PORT".
  explicit TcpProxy(const std::string& target);
  ~TcpProxy();

  // "127.0.0.1:PORT".
  const std::string& address() const { return address_; }
  // Holds for all data from the return on.
  void Set(Mode mode);
  // Delays every byte in both directions.
  void SetDelay(double seconds) { delay_s_ = seconds; }
  // Resets the current connections once.
  void Drop() { drop_ = true; }
  // Number of connections so far, and of those made in state kCut.
  int accepted() const { return accepted_; }
  int refused() const { return refused_; }

 private:
  using Time = std::chrono::steady_clock::time_point;
  struct Chunk {
    Time due;
    std::string bytes;
  };
  // One direction of a connection.
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
  std::atomic<int64_t> rounds_ = 0;  // of the thread; each has one mode
  std::atomic<int> accepted_ = 0, refused_ = 0;
  std::vector<std::unique_ptr<Connection>> connections_;  // of the thread
  std::thread thread_;
};

}  // namespace tessera::e2e
