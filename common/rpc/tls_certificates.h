// TLS certificates in files that may be replaced while the process runs.
#pragma once

#include <memory>
#include <string>

#include "common/base/status.h"

namespace grpc::experimental {
class CertificateProviderInterface;
}  // namespace grpc::experimental

namespace tessera {

// PEM files. Certificate and key: both or neither. `authorities`: those that the process trusts; may be empty.
struct TlsFiles {
  std::string certificate, key, authorities;
};

// PEM texts in use. `own`: the key, then the certificate.
struct TlsTexts {
  std::string own, authorities;
  bool operator==(const TlsTexts&) const = default;
};

// Reads the files again every second. New connections use the renewed content, also of another authority; connections
// that exist go on. A certificate and its key are replaced together, once both files are complete and match; until then
// the previous pair is used, and the log says why. The same holds for the authorities. Thread-safe.
//
// gRPC's own watcher of files would take a half-written pair, and refuse all connections until the pair is complete. So
// it watches copies of the complete files, in memory.
class TlsCertificates {
 public:
  // Errors of reading the files, and INVALID_ARGUMENT with the file and the fault.
  static StatusOr<std::shared_ptr<TlsCertificates>> Open(const TlsFiles& files);
  ~TlsCertificates();

  // For the credentials of a channel or a server, which this object must outlive.
  const std::shared_ptr<grpc::experimental::CertificateProviderInterface>& provider() const;
  // For servers of other libraries.
  TlsTexts texts() const;

 private:
  struct Impl;
  explicit TlsCertificates(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
