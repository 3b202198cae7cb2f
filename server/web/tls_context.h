// The TLS settings of the HTTP server, made from the certificate of the gRPC server.
#pragma once

#include <memory>
#include <mutex>
#include <string>

#include "common/base/status.h"
#include "common/rpc/tls_certificates.h"

struct ssl_ctx_st;

namespace tessera {

// Follows the renewal of the certificate. Thread-safe.
class TlsContext {
 public:
  // TLS 1.2 or later. With authorities, callers need one of their certificates, as of gRPC.
  static StatusOr<std::unique_ptr<TlsContext>> Make(std::shared_ptr<TlsCertificates> certificates);
  ~TlsContext();

  // For a new connection: the certificate of now. Must not be null.
  std::shared_ptr<ssl_ctx_st> Current();

 private:
  explicit TlsContext(std::shared_ptr<TlsCertificates> certificates) : certificates_(std::move(certificates)) {}

  const std::shared_ptr<TlsCertificates> certificates_;
  std::mutex mutex_;
  TlsTexts texts_;  // of context_
  std::shared_ptr<ssl_ctx_st> context_;
};

}  // namespace tessera
