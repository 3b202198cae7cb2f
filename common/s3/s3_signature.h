// AWS Signature Version 4 of requests to S3: in headers, and in the query of a URL.
// https://docs.aws.amazon.com/AmazonS3/latest/API/sig-v4-authenticating-requests.html
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>

#include "common/s3/http_client.h"
#include "common/s3/s3_credentials.h"

namespace tessera {

inline constexpr char kEmptySha256[] = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
inline constexpr char kUnsignedPayload[] = "UNSIGNED-PAYLOAD";

struct S3Request {
  std::string method;
  std::string host;                           // with the port, unless it is the scheme's own
  std::string path;                           // percent-encoded (EncodeUri)
  std::map<std::string, std::string> query;   // names and values as they are
  HttpHeaders headers;                        // all are signed; without Host
  std::string content_sha256 = kEmptySha256;  // or kUnsignedPayload
};

// Percent-encodes all bytes but letters, digits, '-', '.', '_', '~', and '/' if `keep_slashes`.
std::string EncodeUri(std::string_view text, bool keep_slashes);
// The query of a URL, sorted, without '?'.
std::string EncodeQuery(const std::map<std::string, std::string>& query);

// All headers to send: those of the request, x-amz-date, x-amz-content-sha256, x-amz-security-token and authorization.
HttpHeaders SignedHeaders(const S3Request& request, const S3Credentials& credentials, const std::string& region,
                          int64_t unix_us);

// The query of a URL that may be used for `seconds` (1 to 604,800) with exactly the request's headers.
std::string SignedQuery(const S3Request& request, const S3Credentials& credentials, const std::string& region,
                        int64_t unix_us, int64_t seconds);

}  // namespace tessera
