// A certificate authority as its user keeps it: certificate and key in one PEM file.
#pragma once

#include <string>

#include "common/access/certificates.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// True if it can sign.
inline bool RunAuthorityTarget(const std::string& bytes) {
  CertificateTerms terms;
  terms.common_name = "caller";
  terms.expires_s = 3600;
  const StatusOr<Certificate> made = MakeCertificate({bytes, bytes}, terms);
  if (!made.ok()) {
    RequireRefusal(made.status());
    return false;
  }
  Require(made->certificate_pem.find("BEGIN CERTIFICATE") != std::string::npos, "what is signed is a certificate");
  return true;
}

}  // namespace tessera
