// The HTTP server's connections: one thread receives requests without blocking, threads in lanes answer them.
#pragma once

#include <chrono>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "server/web/lanes.h"
#include "server/web/request_frame.h"
#include "server/web/tls_context.h"

namespace tessera {

struct ConnectionLimits {
  int connections = 2048;
  int of_address = 1024;
  double request_s = 20;                      // from a request's first byte to its last, with the handshake
  double idle_s = 75;                         // between two requests
  double answer_s = 30;                       // for the receipt of an answer that fits into memory
  double stall_s = 10;                        // a larger answer must move kLeastBytes in this time
  size_t buffered_bytes = size_t{128} << 20;  // of answers under way, of all connections
  FrameLimits frame;
  // Threads and waiting requests of each lane.
  int quick_threads = 16, slow_threads = 8, file_threads = 24, streams = 64;
  int slow_of_owner = 4, files_of_owner = 8;  // threads
  size_t waiting = 1024;
};

inline constexpr size_t kLeastBytes = 64 << 10;

// A complete request.
struct ReceivedRequest {
  RequestFrame frame;
  std::string body;
  std::string peer;  // as gRPC writes it: ipv4:127.0.0.1:5000
  bool tls = false;
  std::chrono::steady_clock::time_point arrived;  // whole
};

// Where the bytes of one answer go.
class AnswerOutput {
 public:
  virtual ~AnswerOutput() = default;
  // False if the connection is lost or too slow, or the server stops.
  virtual bool Write(std::string_view bytes) = 0;
  virtual bool Connected() = 0;
};

// What answers requests. Thread-safe.
class RequestHandler {
 public:
  virtual ~RequestHandler() = default;
  virtual Lane LaneOf(const RequestFrame& request) = 0;
  // Who the request is from, for the lanes kSlow and kFile, in which each has a share; else empty. Quick.
  virtual std::string OwnerOf(Lane lane, const ReceivedRequest& request) = 0;
  // Writes an answer that needs no waiting, in the receiving thread, as Serve. nullopt: Serve must answer.
  virtual std::optional<bool> ServeAtOnce(const ReceivedRequest& request, AnswerOutput& output) = 0;
  // Writes an answer. False: the connection must end.
  virtual bool Serve(ReceivedRequest request, AnswerOutput& output) = 0;
  // The whole answer to a request that is refused before it is complete or for lack of threads; the connection ends.
  virtual std::string Refusal(int status) = 0;
};

// A connection holds a thread only while it is answered. Answers of the lanes kQuick and kSlow are buffered, and sent
// by the receiving thread, so that slow readers hold no thread either; those of kFile and kStream are written by their
// threads. If there are too many connections, the longest idle one of the address with most of them ends.
class Connections {
 public:
  // `address`: HOST:PORT; port 0: any free one. `tls` (null: none) and `handler` must outlive the result. UNAVAILABLE
  // if it cannot listen.
  static StatusOr<std::unique_ptr<Connections>> Listen(const std::string& address, TlsContext* tls,
                                                       RequestHandler* handler, const ConnectionLimits& limits);
  // Ends all connections. The handler must end its answers soon when Connected is false.
  ~Connections();

  // With the bound port.
  const std::string& address() const;
  int connections() const;
  int threads() const;

 private:
  struct Impl;
  explicit Connections(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
