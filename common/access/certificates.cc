#include "common/access/certificates.h"

#include <arpa/inet.h>
#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/rand.h>
#include <openssl/x509.h>
#include <openssl/x509v3.h>

#include <memory>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

template <class T, void (*free)(T*)>
struct Deleter {
  void operator()(T* object) const { free(object); }
};
using Key = std::unique_ptr<EVP_PKEY, Deleter<EVP_PKEY, EVP_PKEY_free>>;
using X509Ptr = std::unique_ptr<X509, Deleter<X509, X509_free>>;
using Bio = std::unique_ptr<BIO, Deleter<BIO, BIO_free_all>>;
using Extension = std::unique_ptr<X509_EXTENSION, Deleter<X509_EXTENSION, X509_EXTENSION_free>>;

Status OpenSslError(const std::string& what) {
  char reason[256] = "unknown";
  if (const unsigned long error = ERR_get_error(); error != 0) ERR_error_string_n(error, reason, sizeof(reason));
  ERR_clear_error();
  return absl::InternalError(absl::StrCat("cannot ", what, ": ", reason));
}

std::string Content(const Bio& bio) {
  char* data = nullptr;
  const long size = BIO_get_mem_data(bio.get(), &data);
  return std::string(data, static_cast<size_t>(size));
}

StatusOr<Certificate> ToPem(X509* certificate, EVP_PKEY* key) {
  const Bio certificate_bio(BIO_new(BIO_s_mem())), key_bio(BIO_new(BIO_s_mem()));
  if (PEM_write_bio_X509(certificate_bio.get(), certificate) != 1 ||
      PEM_write_bio_PrivateKey(key_bio.get(), key, nullptr, nullptr, 0, nullptr, nullptr) != 1) {
    return OpenSslError("write a certificate");
  }
  return Certificate{Content(certificate_bio), Content(key_bio)};
}

bool AddExtension(X509* certificate, X509* issuer, int kind, const std::string& value) {
  X509V3_CTX context;
  X509V3_set_ctx_nodb(&context);
  X509V3_set_ctx(&context, issuer, certificate, nullptr, nullptr, 0);
  const Extension extension(X509V3_EXT_conf_nid(nullptr, &context, kind, value.c_str()));
  return extension != nullptr && X509_add_ext(certificate, extension.get(), -1) == 1;
}

// The hosts as a subject alternative name, such as "DNS:city-server,IP:10.0.0.1". INVALID_ARGUMENT for a host that is
// neither a DNS name nor an IP address.
StatusOr<std::string> AlternativeNames(const std::vector<std::string>& hosts) {
  std::string names;
  for (const std::string& host : hosts) {
    unsigned char address[16];
    const bool ip =
        ::inet_pton(AF_INET, host.c_str(), address) == 1 || ::inet_pton(AF_INET6, host.c_str(), address) == 1;
    const bool good =
        ip || (!host.empty() && host.size() <= 253 &&
               host.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-*") ==
                   std::string::npos);
    if (!good) return absl::InvalidArgumentError("found host '" + host + "', expected a host name or an IP address");
    absl::StrAppend(&names, names.empty() ? "" : ",", ip ? "IP:" : "DNS:", host);
  }
  return names;
}

// The hash for signatures by `key`; null for Ed25519 and Ed448, which define their own.
const EVP_MD* HashFor(const EVP_PKEY* key) {
  return EVP_PKEY_is_a(key, "ED25519") == 1 || EVP_PKEY_is_a(key, "ED448") == 1 ? nullptr : EVP_sha256();
}

// Makes OpenSSL fail on an encrypted key instead of asking for its password on the terminal.
int NoPassword(char*, int, int, void*) { return -1; }

Bio Reader(const std::string& pem) { return Bio(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size()))); }

// All certificates of a PEM file; the first one is the owner's.
StatusOr<std::vector<X509Ptr>> ReadCertificates(const std::string& file, const std::string& pem) {
  ERR_clear_error();
  const Bio reader = Reader(pem);
  std::vector<X509Ptr> found;
  while (X509Ptr next{PEM_read_bio_X509(reader.get(), nullptr, NoPassword, nullptr)}) found.push_back(std::move(next));
  const unsigned long error = ERR_peek_last_error();
  ERR_clear_error();
  const bool at_end = ERR_GET_LIB(error) == ERR_LIB_PEM && ERR_GET_REASON(error) == PEM_R_NO_START_LINE;
  if (!found.empty() && at_end) return found;
  return InputError(file, absl::StrCat("certificate ", found.size() + 1),
                    pem.empty() ? "an empty file" : "no complete certificate", "certificates in PEM");
}

// `issuer`, `issuer_key`: null for a self-signed certificate.
StatusOr<Certificate> Make(const CertificateTerms& terms, X509* issuer, EVP_PKEY* issuer_key) {
  const Key key(EVP_EC_gen("P-256"));
  const X509Ptr certificate(X509_new());
  if (key == nullptr || certificate == nullptr) return OpenSslError("make a key");
  X509* const made = certificate.get();
  X509* const signer = issuer != nullptr ? issuer : made;
  TESSERA_ASSIGN_OR_RETURN(const std::string names, AlternativeNames(terms.hosts));
  unsigned char serial[16];
  RAND_bytes(serial, sizeof(serial));
  serial[0] &= 0x7F;
  BIGNUM* const number = BN_bin2bn(serial, sizeof(serial), nullptr);
  bool good = number != nullptr && BN_to_ASN1_INTEGER(number, X509_get_serialNumber(made)) != nullptr;
  BN_free(number);
  good = good && X509_set_version(made, 2) == 1;
  good = good && ASN1_TIME_set(X509_getm_notBefore(made), static_cast<time_t>(terms.now_s + terms.begins_s)) != nullptr;
  good = good && ASN1_TIME_set(X509_getm_notAfter(made), static_cast<time_t>(terms.now_s + terms.expires_s)) != nullptr;
  good = good && X509_set_pubkey(made, key.get()) == 1;
  good = good &&
         X509_NAME_add_entry_by_txt(X509_get_subject_name(made), "CN", MBSTRING_UTF8,
                                    reinterpret_cast<const unsigned char*>(terms.common_name.c_str()), -1, -1, 0) == 1;
  good = good && X509_set_issuer_name(made, X509_get_subject_name(signer)) == 1;
  if (issuer == nullptr) {
    good = good && AddExtension(made, signer, NID_basic_constraints, "critical,CA:TRUE,pathlen:0");
    good = good && AddExtension(made, signer, NID_key_usage, "critical,keyCertSign,cRLSign");
  } else {
    good = good && AddExtension(made, signer, NID_basic_constraints, "critical,CA:FALSE");
    good = good && AddExtension(made, signer, NID_key_usage, "critical,digitalSignature");
    good = good && AddExtension(made, signer, NID_ext_key_usage, names.empty() ? "clientAuth" : "serverAuth");
    if (!names.empty()) good = good && AddExtension(made, signer, NID_subject_alt_name, names);
    // Tells authorities of the same name apart where both are trusted, as during a renewal.
    good = good && AddExtension(made, signer, NID_authority_key_identifier, "keyid:always");
  }
  good = good && AddExtension(made, signer, NID_subject_key_identifier, "hash");
  EVP_PKEY* const signing = issuer_key != nullptr ? issuer_key : key.get();
  if (!good) return OpenSslError("make a certificate");
  if (X509_sign(made, signing, HashFor(signing)) == 0) {
    const Status status = OpenSslError("sign with the authority's key");
    return issuer_key == nullptr ? status : absl::InvalidArgumentError(status.message());
  }
  return ToPem(made, key.get());
}

}  // namespace

StatusOr<Certificate> MakeAuthority(const CertificateTerms& terms) { return Make(terms, nullptr, nullptr); }

StatusOr<Certificate> MakeCertificate(const Certificate& authority, const CertificateTerms& terms) {
  const X509Ptr issuer(PEM_read_bio_X509(Reader(authority.certificate_pem).get(), nullptr, NoPassword, nullptr));
  const Key key(PEM_read_bio_PrivateKey(Reader(authority.key_pem).get(), nullptr, NoPassword, nullptr));
  if (issuer == nullptr || key == nullptr || X509_check_private_key(issuer.get(), key.get()) != 1) {
    ERR_clear_error();
    return absl::InvalidArgumentError(
        "cannot read the certificate authority: expected a certificate and its private key in PEM, without a password");
  }
  return Make(terms, issuer.get(), key.get());
}

Status CheckCertificate(const std::string& certificate_file, const std::string& certificate_pem,
                        const std::string& key_file, const std::string& key_pem) {
  TESSERA_ASSIGN_OR_RETURN(const std::vector<X509Ptr> chain, ReadCertificates(certificate_file, certificate_pem));
  const Key key(PEM_read_bio_PrivateKey(Reader(key_pem).get(), nullptr, NoPassword, nullptr));
  const bool matches = key != nullptr && X509_check_private_key(chain.front().get(), key.get()) == 1;
  ERR_clear_error();
  if (key == nullptr) {
    return InputError(key_file, "", key_pem.empty() ? "an empty file" : "no complete private key",
                      "a private key in PEM, without a password");
  }
  if (!matches) return InputError(key_file, "", "another key", "the key of the certificate in " + certificate_file);
  return absl::OkStatus();
}

Status CheckAuthorities(const std::string& file, const std::string& pem) {
  return ReadCertificates(file, pem).status();
}

}  // namespace tessera
