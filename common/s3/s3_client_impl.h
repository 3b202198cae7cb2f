// What the parts of S3Client share.
#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

#include "common/s3/http_client.h"
#include "common/s3/s3_client.h"
#include "common/s3/s3_errors.h"
#include "common/s3/s3_signature.h"

namespace tessera {

// A call of a store, repeated until it succeeds or fails for good.
struct S3Call {
  const char* counter = "";  // of S3Client::counts
  std::string method = "GET";
  std::optional<std::string> key;  // none: a call of the bucket
  std::map<std::string, std::string> query;
  HttpHeaders headers;
  std::optional<HttpBody> body;
  std::string sha256 = kEmptySha256;  // of the body
  bool accept_range_errors = false;   // answers with status 412 and 416 are no errors
  bool error_in_body = false;         // an answer with status 200 may contain an error
  std::function<Status(const HttpAnswer& head, std::string_view bytes)> take;
  int64_t max_answer_bytes = int64_t{16} << 20;
};

struct S3Client::Impl {
  Impl(const S3Location& to, S3CredentialsSource* from, const Clock* time, const S3ClientOptions& how);

  // OK only for status 2xx (and accept_range_errors). One attempt.
  StatusOr<HttpAnswer> Attempt(const S3Call& call, bool repeated);
  // With retries.
  StatusOr<HttpAnswer> Send(const S3Call& call);
  // The policy of one call: each has its own jitter.
  RetryPolicy Policy();
  std::string FullKey(const std::string& key) const { return location.prefix + key; }
  std::string Name(const std::optional<std::string>& key) const;
  S3Request RequestOf(const std::string& method, const std::optional<std::string>& key) const;
  std::string UrlOf(const S3Request& request, const std::string& query) const;
  StatusOr<SignedRequest> Sign(S3Request request, double seconds);
  void Count(const char* counter, const std::function<void(S3Counts*)>& change);

  StatusOr<std::string> PutPart(const std::string& key, const std::string& id, int part, const HttpBody& body,
                                const std::string& sha256);
  Status CopyObject(const std::string& from, const std::string& to);

  const S3Location location;
  S3CredentialsSource* const credentials;
  const Clock* const clock;
  const S3ClientOptions options;
  const HttpClient http;
  std::string scheme, host;  // "https://", "s3.example.org:8080"
  std::string root;          // path of the bucket, without a slash at its end
  std::atomic<uint64_t> calls{0};

  std::mutex mutex;
  std::map<std::string, S3Counts> counts;  // guarded by mutex
};

}  // namespace tessera
