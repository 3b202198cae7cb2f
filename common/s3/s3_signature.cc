#include "common/s3/s3_signature.h"

#include <openssl/evp.h>
#include <openssl/hmac.h>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/time.h"
#include "common/storage/hash.h"

namespace tessera {
namespace {

constexpr char kAlgorithm[] = "AWS4-HMAC-SHA256";

// 32 bytes.
std::string Hmac(const std::string& key, const std::string& message) {
  unsigned char code[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  ::HMAC(EVP_sha256(), key.data(), static_cast<int>(key.size()), reinterpret_cast<const unsigned char*>(message.data()),
         message.size(), code, &size);
  return {reinterpret_cast<const char*>(code), size};
}

std::string Timestamp(int64_t unix_us) {
  return absl::FormatTime("%Y%m%dT%H%M%SZ", absl::FromUnixMicros(unix_us), absl::UTCTimeZone());
}

std::string Scope(const std::string& timestamp, const std::string& region) {
  return absl::StrCat(timestamp.substr(0, 8), "/", region, "/s3/aws4_request");
}

std::string NamesOf(const HttpHeaders& headers) {
  std::string names;
  for (const auto& [name, value] : headers) absl::StrAppend(&names, names.empty() ? "" : ";", name);
  return names;
}

// `headers`: all signed ones, with Host.
std::string Signature(const S3Request& request, const std::string& query, const HttpHeaders& headers,
                      const std::string& secret_key, const std::string& timestamp, const std::string& region) {
  std::string canonical = absl::StrCat(request.method, "\n", request.path, "\n", query, "\n");
  for (const auto& [name, value] : headers) absl::StrAppend(&canonical, name, ":", value, "\n");
  absl::StrAppend(&canonical, "\n", NamesOf(headers), "\n", request.content_sha256);
  const std::string text =
      absl::StrCat(kAlgorithm, "\n", timestamp, "\n", Scope(timestamp, region), "\n", Sha256Hex(canonical));
  std::string key = Hmac("AWS4" + secret_key, timestamp.substr(0, 8));
  for (const std::string& part : {region, std::string("s3"), std::string("aws4_request")}) key = Hmac(key, part);
  return absl::BytesToHexString(Hmac(key, text));
}

}  // namespace

std::string EncodeUri(std::string_view text, bool keep_slashes) {
  std::string encoded;
  for (const char c : text) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ||
                       c == '.' || c == '_' || c == '~' || (c == '/' && keep_slashes);
    if (plain) {
      encoded.push_back(c);
    } else {
      absl::StrAppendFormat(&encoded, "%%%02X", static_cast<unsigned char>(c));
    }
  }
  return encoded;
}

std::string EncodeQuery(const std::map<std::string, std::string>& query) {
  std::string encoded;
  for (const auto& [name, value] : query) {
    absl::StrAppend(&encoded, encoded.empty() ? "" : "&", EncodeUri(name, false), "=", EncodeUri(value, false));
  }
  return encoded;
}

HttpHeaders SignedHeaders(const S3Request& request, const S3Credentials& credentials, const std::string& region,
                          int64_t unix_us) {
  const std::string timestamp = Timestamp(unix_us);
  HttpHeaders headers = request.headers;
  headers["x-amz-date"] = timestamp;
  headers["x-amz-content-sha256"] = request.content_sha256;
  if (!credentials.session_token.empty()) headers["x-amz-security-token"] = credentials.session_token;
  HttpHeaders with_host = headers;
  with_host["host"] = request.host;
  headers["authorization"] = absl::StrCat(
      kAlgorithm, " Credential=", credentials.access_key, "/", Scope(timestamp, region),
      ",SignedHeaders=", NamesOf(with_host), ",Signature=",
      Signature(request, EncodeQuery(request.query), with_host, credentials.secret_key, timestamp, region));
  return headers;
}

std::string SignedQuery(const S3Request& request, const S3Credentials& credentials, const std::string& region,
                        int64_t unix_us, int64_t seconds) {
  const std::string timestamp = Timestamp(unix_us);
  HttpHeaders with_host = request.headers;
  with_host["host"] = request.host;
  std::map<std::string, std::string> query = request.query;
  query["X-Amz-Algorithm"] = kAlgorithm;
  query["X-Amz-Credential"] = absl::StrCat(credentials.access_key, "/", Scope(timestamp, region));
  query["X-Amz-Date"] = timestamp;
  query["X-Amz-Expires"] = absl::StrCat(seconds);
  query["X-Amz-SignedHeaders"] = NamesOf(with_host);
  if (!credentials.session_token.empty()) query["X-Amz-Security-Token"] = credentials.session_token;
  const std::string encoded = EncodeQuery(query);
  return absl::StrCat(
      encoded, "&X-Amz-Signature=", Signature(request, encoded, with_host, credentials.secret_key, timestamp, region));
}

}  // namespace tessera
