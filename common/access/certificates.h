// X.509 certificates for TLS: a private certificate authority, and the certificates that it signs for coordinators and
// (with mutual TLS) for their clients. Keys are on the curve P-256.
#pragma once

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
  // DNS names and IP addresses of a server; empty: a client's certificate.
  std::vector<std::string> hosts;
  int64_t now_s = 0;      // Unix time
  int64_t begins_s = 0;   // start of validity, relative to `now_s`; may be negative
  int64_t expires_s = 0;  // end of validity, relative to `now_s`
};

// A self-signed certificate that may sign others. Both functions are thread-safe.
StatusOr<Certificate> MakeAuthority(const CertificateTerms& terms);

// A certificate signed by `authority`. INVALID_ARGUMENT if `authority` does not hold a certificate and its key.
StatusOr<Certificate> MakeCertificate(const Certificate& authority, const CertificateTerms& terms);

// Whether the PEM files are complete. INVALID_ARGUMENT with the file and the fault. Does not check validity dates or
// signatures. Thread-safe.
//
// A certificate, with those of intermediate authorities after it, and its key, which must match and have no password.
Status CheckCertificate(const std::string& certificate_file, const std::string& certificate_pem,
                        const std::string& key_file, const std::string& key_pem);
// One or more certificates of authorities.
Status CheckAuthorities(const std::string& file, const std::string& pem);

}  // namespace tessera
