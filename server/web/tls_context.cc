#include "server/web/tls_context.h"

#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/ssl.h>

#include <utility>

namespace tessera {
namespace {

constexpr char kAlpn[] = "\x08http/1.1";

using Bio = std::unique_ptr<BIO, decltype(&BIO_free)>;
using Key = std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)>;
using X509Certificate = std::unique_ptr<X509, decltype(&X509_free)>;

Bio BioOf(const std::string& text) { return {BIO_new_mem_buf(text.data(), static_cast<int>(text.size())), &BIO_free}; }

int SelectHttp(SSL*, const unsigned char** chosen, unsigned char* size, const unsigned char* offered,
               unsigned int offered_size, void*) {
  return SSL_select_next_proto(const_cast<unsigned char**>(chosen), size, reinterpret_cast<const unsigned char*>(kAlpn),
                               sizeof(kAlpn) - 1, offered, offered_size) == OPENSSL_NPN_NEGOTIATED
             ? SSL_TLSEXT_ERR_OK
             : SSL_TLSEXT_ERR_ALERT_FATAL;
}

bool UseOwn(SSL_CTX* context, const std::string& pem) {
  const Bio of_key = BioOf(pem), of_chain = BioOf(pem);
  const Key key(PEM_read_bio_PrivateKey(of_key.get(), nullptr, nullptr, nullptr), &EVP_PKEY_free);
  const X509Certificate own(PEM_read_bio_X509(of_chain.get(), nullptr, nullptr, nullptr), &X509_free);
  if (key == nullptr || own == nullptr || SSL_CTX_use_certificate(context, own.get()) != 1 ||
      SSL_CTX_use_PrivateKey(context, key.get()) != 1) {
    return false;
  }
  while (X509* const next = PEM_read_bio_X509(of_chain.get(), nullptr, nullptr, nullptr)) {
    if (SSL_CTX_add0_chain_cert(context, next) == 1) continue;
    X509_free(next);
    return false;
  }
  return true;
}

bool RequireCallersOf(SSL_CTX* context, const std::string& authorities) {
  const Bio bio = BioOf(authorities);
  X509_STORE* const store = SSL_CTX_get_cert_store(context);
  bool any = false;
  while (X509* const authority = PEM_read_bio_X509(bio.get(), nullptr, nullptr, nullptr)) {
    const X509Certificate owner(authority, &X509_free);
    any = X509_STORE_add_cert(store, authority) == 1 && SSL_CTX_add_client_CA(context, authority) == 1;
    if (!any) return false;
  }
  SSL_CTX_set_verify(context, SSL_VERIFY_PEER | SSL_VERIFY_FAIL_IF_NO_PEER_CERT, nullptr);
  return any;
}

StatusOr<std::shared_ptr<SSL_CTX>> ContextOf(const TlsTexts& texts) {
  const std::shared_ptr<SSL_CTX> context(SSL_CTX_new(TLS_server_method()), &SSL_CTX_free);
  if (context == nullptr) return absl::InternalError("cannot make a TLS context");
  SSL_CTX_set_min_proto_version(context.get(), TLS1_2_VERSION);
  SSL_CTX_set_options(context.get(), SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_COMPRESSION | SSL_OP_CIPHER_SERVER_PREFERENCE);
  SSL_CTX_set_mode(context.get(),
                   SSL_MODE_RELEASE_BUFFERS | SSL_MODE_ENABLE_PARTIAL_WRITE | SSL_MODE_ACCEPT_MOVING_WRITE_BUFFER);
  SSL_CTX_set_alpn_select_cb(context.get(), &SelectHttp, nullptr);
  constexpr unsigned char kSessions[] = "tesserad";
  SSL_CTX_set_session_id_context(context.get(), kSessions, sizeof(kSessions) - 1);
  SSL_CTX_set_session_cache_mode(context.get(), SSL_SESS_CACHE_OFF);  // clients keep tickets
  ERR_clear_error();
  const bool good = UseOwn(context.get(), texts.own) &&
                    (texts.authorities.empty() || RequireCallersOf(context.get(), texts.authorities));
  ERR_clear_error();
  if (!good) return absl::InvalidArgumentError("the certificate cannot be used for HTTPS");
  return context;
}

}  // namespace

StatusOr<std::unique_ptr<TlsContext>> TlsContext::Make(std::shared_ptr<TlsCertificates> certificates) {
  std::unique_ptr<TlsContext> made(new TlsContext(std::move(certificates)));
  made->texts_ = made->certificates_->texts();
  TESSERA_ASSIGN_OR_RETURN(made->context_, ContextOf(made->texts_));
  return made;
}

TlsContext::~TlsContext() = default;

std::shared_ptr<SSL_CTX> TlsContext::Current() {
  TlsTexts texts = certificates_->texts();
  std::lock_guard lock(mutex_);
  if (texts == texts_) return context_;
  // TlsCertificates has checked the texts. An older context remains if OpenSSL still refuses them.
  if (auto renewed = ContextOf(texts); renewed.ok()) context_ = *std::move(renewed);
  texts_ = std::move(texts);
  return context_;
}

}  // namespace tessera
