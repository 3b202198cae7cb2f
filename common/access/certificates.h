// X.509 certificates for coordinators and, where they are asked for, for those who call them: a certificate authority
// of one's own and what it signs. Keys are on P-256.
#ifndef TESSERA_COMMON_ACCESS_CERTIFICATES_H_
#define TESSERA_COMMON_ACCESS_CERTIFICATES_H_

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

struct Certificate {
  std::string certificate_pem;
  std::string key_pem;  // private
};

struct CertificateTerms {
  std::string common_name;
  // DNS names and IP addresses of a server; none: it is a caller's.
  std::vector<std::string> hosts;
  int64_t now_s = 0;      // Unix time
  int64_t begins_s = 0;   // after `now_s`; may be negative
  int64_t expires_s = 0;  // after `now_s`
};

// Signs itself, and may sign others. Thread-safe, as below.
StatusOr<Certificate> MakeAuthority(const CertificateTerms& terms);

// Signed by `authority`. INVALID_ARGUMENT if that is none.
StatusOr<Certificate> MakeCertificate(const Certificate& authority, const CertificateTerms& terms);

}  // namespace tessera

#endif  // TESSERA_COMMON_ACCESS_CERTIFICATES_H_
