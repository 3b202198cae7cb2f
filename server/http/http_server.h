// The coordinator's HTTP server: the page, the API beneath it, and files of jobs.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "common/base/status.h"
#include "server/grpc/coordinator_server.h"
#include "server/metrics/http_counts.h"
#include "server/web/connections.h"

namespace tessera {

struct HttpOptions {
  std::string address;                      // HOST:PORT; port 0: any free one. ListenOptions::http, already checked
  bool insecure = false;                    // as ListenOptions
  std::string version;                      // of the program
  std::function<void()> before_reply = {};  // as ServerEnvironment
  ConnectionLimits limits;
  HttpCounts* counts = nullptr;  // by HttpRouteNames(); null: none
};

// Serves HTTPS if the gRPC server has a certificate, which both renew together, else HTTP. Every request has the rights
// of its token, and its calls are those of the gRPC server.
class HttpServer {
 public:
  // `server` must outlive the result. UNAVAILABLE if it cannot listen.
  static StatusOr<std::unique_ptr<HttpServer>> Start(const HttpOptions& options, CoordinatorServer* server);
  // Cancels running calls and ends all connections.
  ~HttpServer();

  // With the bound port.
  const std::string& address() const;
  // "https://HOST:PORT/".
  std::string url() const;
  // Threads that serve requests now.
  int threads() const;

 private:
  struct Impl;
  explicit HttpServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
