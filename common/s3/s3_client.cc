#include "common/s3/s3_client.h"

#include <openssl/evp.h>

#include <algorithm>
#include <cmath>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "common/base/printable.h"
#include "common/base/random.h"
#include "common/s3/object_stream.h"
#include "common/s3/s3_answers.h"
#include "common/s3/s3_client_impl.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"

namespace tessera {
namespace {

constexpr size_t kDeleteBatch = 1000;
constexpr size_t kMaxUploads = 10'000;
constexpr int64_t kMaxUrlSeconds = 7 * 24 * 3600;

// INTERNAL for an answer that cannot be read.
template <class Value>
StatusOr<Value> ReadAnswer(const std::string& what, StatusOr<Value> value) {
  if (value.ok()) return value;
  return absl::InternalError(absl::StrCat(what, ": ", std::string(value.status().message())));
}

std::string Md5Base64(const std::string& bytes) {
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  EVP_Digest(bytes.data(), bytes.size(), digest, &size, EVP_md5(), nullptr);
  return absl::Base64Escape(absl::string_view(reinterpret_cast<const char*>(digest), size));
}

}  // namespace

S3Client::Impl::Impl(const S3Location& to, S3CredentialsSource* from, const Clock* time, const S3ClientOptions& how)
    : location(to),
      credentials(from),
      clock(time),
      options(how),
      http({.ca_file = how.ca_file, .connect_s = how.connect_s, .silence_s = how.silence_s}) {
  const size_t after = location.endpoint.find("://") + 3;
  scheme = location.endpoint.substr(0, after);
  host = location.endpoint.substr(after);
  // Amazon's certificates hold for names without dots below its own.
  if (host.ends_with(".amazonaws.com") && location.bucket.find('.') == std::string::npos) {
    host = location.bucket + "." + host;
  } else {
    root = "/" + location.bucket;
  }
}

std::string S3Client::Impl::Name(const std::optional<std::string>& key) const {
  return ToText(location) + (key ? Printable(*key) : "");
}

S3Request S3Client::Impl::RequestOf(const std::string& method, const std::optional<std::string>& key) const {
  S3Request request;
  request.method = method;
  request.host = host;
  request.path = key ? absl::StrCat(root, "/", EncodeUri(FullKey(*key), true)) : root.empty() ? "/" : root;
  return request;
}

std::string S3Client::Impl::UrlOf(const S3Request& request, const std::string& query) const {
  return absl::StrCat(scheme, request.host, request.path, query.empty() ? "" : "?", query);
}

RetryPolicy S3Client::Impl::Policy() {
  RetryPolicy policy = options.retry;
  policy.seed = MixBits(policy.seed ^ MixBits(++calls));
  return policy;
}

void S3Client::Impl::Count(const char* counter, const std::function<void(S3Counts*)>& change) {
  const std::lock_guard lock(mutex);
  change(&counts[counter]);
}

StatusOr<HttpAnswer> S3Client::Impl::Attempt(const S3Call& call, bool repeated) {
  if (call.key) TESSERA_RETURN_IF_ERROR(CheckS3Key(FullKey(*call.key)));
  TESSERA_ASSIGN_OR_RETURN(const S3Credentials secrets, credentials->Get());
  S3Request request = RequestOf(call.method, call.key);
  request.query = call.query;
  request.headers = call.headers;
  request.content_sha256 = call.sha256;
  const int64_t now_us = clock->UnixTimeUs(), start_us = clock->MonotonicUs();
  HttpRequest http_request;
  http_request.method = call.method;
  http_request.url = UrlOf(request, EncodeQuery(request.query));
  http_request.headers = SignedHeaders(request, secrets, location.region, now_us);
  http_request.body = call.body;
  http_request.take = call.take;
  http_request.max_answer_bytes = call.max_answer_bytes;
  HttpTraffic traffic;
  StatusOr<HttpAnswer> answer = http.Send(http_request, &traffic);
  const S3ErrorContext context{
      Name(call.key), now_us, {secrets.secret_key, secrets.session_token, secrets.access_key}, false};
  Status status = answer.status();
  if (!answer.ok()) {
    if (!call.take) status = Status(status.code(), absl::StrCat(context.object, ": ", std::string(status.message())));
  } else if (answer->status / 100 == 2) {
    const std::optional<S3ErrorAnswer> error = call.error_in_body ? S3ErrorIn(answer->body) : std::nullopt;
    if (error) status = S3ErrorOf(*error, answer->status, *answer, context);
  } else if (!call.accept_range_errors || (answer->status != 412 && answer->status != 416)) {
    status = S3ErrorOf(*answer, context);
  }
  Count(call.counter, [&](S3Counts* count) {
    ++count->calls;
    count->retries += repeated;
    count->errors += !status.ok() && !absl::IsNotFound(status) && !absl::IsFailedPrecondition(status);
    count->sent_bytes += traffic.sent_bytes;
    count->received_bytes += traffic.received_bytes;
    count->seconds += static_cast<double>(clock->MonotonicUs() - start_us) * 1e-6;
  });
  if (!status.ok()) return status;
  return answer;
}

StatusOr<HttpAnswer> S3Client::Impl::Send(const S3Call& call) {
  HttpAnswer result;
  bool repeated = false;
  TESSERA_RETURN_IF_ERROR(Retry(Policy(), Idempotency::kOnce, options.sleeper, [&] {
    StatusOr<HttpAnswer> answer = Attempt(call, repeated);
    repeated = true;
    if (answer.ok()) result = *std::move(answer);
    return answer.status();
  }));
  return result;
}

StatusOr<std::unique_ptr<S3Client>> S3Client::Create(const S3Location& location, S3CredentialsSource* credentials,
                                                     const Clock* clock, const S3ClientOptions& options) {
  if (!options.ca_file.empty()) {
    const StatusOr<std::string> authorities = ReadFileRange(options.ca_file, 0, 1);
    if (!authorities.ok()) return absl::InvalidArgumentError(authorities.status().message());
  }
  return std::unique_ptr<S3Client>(new S3Client(std::make_unique<Impl>(location, credentials, clock, options)));
}

S3Client::S3Client(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
S3Client::~S3Client() = default;
const S3Location& S3Client::location() const { return impl_->location; }

StatusOr<S3Object> S3Client::Head(const std::string& key) {
  S3Call call;
  call.counter = "head";
  call.method = "HEAD";
  call.key = key;
  TESSERA_ASSIGN_OR_RETURN(const HttpAnswer answer, impl_->Send(call));
  const std::optional<int64_t> size = answer.Number("content-length"), time = answer.Time("last-modified");
  const std::optional<std::string> etag = ParseEtag(answer.Header("etag"));
  if (!size || !time || !etag) {
    return absl::InternalError(impl_->Name(key) +
                               ": the store's answer lacks Content-Length, Last-Modified or ETag, or has a wrong one");
  }
  const std::string& sha256 = answer.Header(kSha256Header);
  return S3Object{key, *size, *time, *etag, CheckDigest({sha256, 0}).ok() ? sha256 : ""};
}

StatusOr<std::string> S3Client::Get(const std::string& key, int64_t offset_bytes, int64_t size_bytes) {
  if (offset_bytes < 0 || size_bytes <= 0) return std::string();
  S3Call call;
  call.counter = "get";
  call.key = key;
  call.headers["range"] = absl::StrCat("bytes=", offset_bytes, "-", offset_bytes + size_bytes - 1);
  call.accept_range_errors = true;
  call.max_answer_bytes = size_bytes;
  TESSERA_ASSIGN_OR_RETURN(HttpAnswer answer, impl_->Send(call));
  if (answer.status / 100 != 2) return std::string();  // the object has no byte at the offset
  TESSERA_ASSIGN_OR_RETURN(const ObjectRange range, ReadAnswer(impl_->Name(key), RangeOf(answer, offset_bytes)));
  const int64_t wanted = std::min(size_bytes, range.total_bytes - offset_bytes);
  if (static_cast<int64_t>(answer.body.size()) != wanted) {
    return absl::InternalError(
        absl::StrCat(impl_->Name(key), ": the store sent ", answer.body.size(), " bytes of ", wanted));
  }
  return std::move(answer.body);
}

Status S3Client::Stream(const std::string& key, int64_t offset_bytes,
                        const std::function<Status(std::string_view bytes)>& take) {
  bool repeated = false;
  const SendGet send = [&](const HttpHeaders& headers, const auto& take_part) {
    S3Call call;
    call.counter = "get";
    call.key = key;
    call.headers = headers;
    call.accept_range_errors = true;
    call.take = take_part;
    StatusOr<HttpAnswer> answer = impl_->Attempt(call, repeated);
    repeated = true;
    return answer;
  };
  return StreamObject(impl_->Name(key), send, offset_bytes, impl_->Policy(), impl_->options.sleeper, take);
}

Status S3Client::Put(const std::string& key, std::string_view bytes, const std::string& sha256,
                     S3PutCondition condition) {
  S3Call call;
  call.counter = "put";
  call.method = "PUT";
  call.key = key;
  call.body = HttpBody{.bytes = bytes};
  call.sha256 = sha256;
  if (condition.only_if_absent) call.headers["if-none-match"] = "*";
  return impl_->Send(call).status();
}

StatusOr<S3Page> S3Client::List(const std::string& key_prefix, const std::string& from) {
  S3Call call;
  call.counter = "list";
  const std::string prefix = impl_->FullKey(key_prefix);
  call.query = {{"list-type", "2"}, {"encoding-type", "url"}, {"prefix", prefix}};
  if (!from.empty()) call.query["continuation-token"] = from;
  TESSERA_ASSIGN_OR_RETURN(const HttpAnswer answer, impl_->Send(call));
  const std::string what = impl_->Name(std::nullopt);
  TESSERA_ASSIGN_OR_RETURN(S3Page page, ReadAnswer(what, ParseS3Listing(answer.body)));
  for (S3Object& object : page.objects) {
    if (!object.key.starts_with(prefix)) {
      return absl::InternalError(what + ": the store listed a key with another prefix");
    }
    object.key.erase(0, impl_->location.prefix.size());
  }
  if (!from.empty() && page.next == from) return absl::InternalError(what + ": the store lists the same page again");
  return page;
}

Status S3Client::Delete(const std::vector<std::string>& keys) {
  for (size_t begin = 0; begin < keys.size(); begin += kDeleteBatch) {
    std::string xml = "<Delete><Quiet>true</Quiet>";
    for (size_t i = begin; i < std::min(keys.size(), begin + kDeleteBatch); ++i) {
      TESSERA_RETURN_IF_ERROR(CheckS3Key(impl_->FullKey(keys[i])));
      absl::StrAppend(&xml, "<Object><Key>", EscapeS3Xml(impl_->FullKey(keys[i])), "</Key></Object>");
    }
    xml += "</Delete>";
    S3Call call;
    call.counter = "delete";
    call.method = "POST";
    call.query = {{"delete", ""}};
    call.headers = {{"content-md5", Md5Base64(xml)}, {"content-type", "application/xml"}};
    call.body = HttpBody{.bytes = xml};
    call.sha256 = Sha256Hex(xml);
    const std::string what = impl_->Name(std::nullopt);
    TESSERA_RETURN_IF_ERROR(Retry(impl_->Policy(), Idempotency::kOnce, impl_->options.sleeper, [&]() -> Status {
      TESSERA_ASSIGN_OR_RETURN(const HttpAnswer answer, impl_->Send(call));
      TESSERA_ASSIGN_OR_RETURN(const std::vector<S3DeleteError> errors,
                               ReadAnswer(what, ParseS3DeleteErrors(answer.body)));
      for (const S3DeleteError& error : errors) {
        if (error.code == "NoSuchKey") continue;
        const S3ErrorAnswer same{error.code, error.message, "", "", ""};
        return S3ErrorOf(same, error.code == "AccessDenied" ? 403 : 400, answer,
                         {what + Printable(error.key), 0, {}, false});
      }
      return absl::OkStatus();
    }));
  }
  return absl::OkStatus();
}

StatusOr<std::vector<S3Upload>> S3Client::ListUploads(const std::string& key_prefix) {
  std::vector<S3Upload> uploads;
  const std::string prefix = impl_->FullKey(key_prefix), what = impl_->Name(std::nullopt);
  S3UploadPage page;
  do {
    S3Call call;
    call.counter = "upload";
    call.query = {{"uploads", ""}, {"prefix", prefix}};
    if (!page.next_key.empty()) call.query["key-marker"] = page.next_key;
    if (!page.next_id.empty()) call.query["upload-id-marker"] = page.next_id;
    TESSERA_ASSIGN_OR_RETURN(const HttpAnswer answer, impl_->Send(call));
    TESSERA_ASSIGN_OR_RETURN(page, ReadAnswer(what, ParseS3Uploads(answer.body)));
    if (page.uploads.empty()) break;
    for (S3Upload& upload : page.uploads) {
      if (!upload.key.starts_with(prefix)) {
        return absl::InternalError(what + ": the store listed an upload with another prefix");
      }
      upload.key.erase(0, impl_->location.prefix.size());
      uploads.push_back(std::move(upload));
    }
  } while (!page.next_key.empty() && uploads.size() < kMaxUploads);
  return uploads;
}

StatusOr<SignedRequest> S3Client::Impl::Sign(S3Request request, double seconds) {
  TESSERA_ASSIGN_OR_RETURN(const S3Credentials secrets, credentials->Get());
  const int64_t whole = std::clamp<int64_t>(std::llround(seconds), 1, kMaxUrlSeconds);
  const std::string query = SignedQuery(request, secrets, location.region, clock->UnixTimeUs(), whole);
  return SignedRequest{request.method, UrlOf(request, query), request.headers};
}

StatusOr<SignedRequest> S3Client::SignGet(const std::string& key, double seconds) {
  TESSERA_RETURN_IF_ERROR(CheckS3Key(impl_->FullKey(key)));
  S3Request request = impl_->RequestOf("GET", key);
  request.content_sha256 = kUnsignedPayload;
  return impl_->Sign(std::move(request), seconds);
}

StatusOr<SignedRequest> S3Client::SignPut(const std::string& key, const std::string& sha256, int64_t size_bytes,
                                          double seconds, SignedHash hash) {
  return SignPart(key, "", 0, sha256, size_bytes, seconds, hash);
}

StatusOr<SignedRequest> S3Client::SignPart(const std::string& key, const std::string& upload, int part,
                                           const std::string& sha256, int64_t size_bytes, double seconds,
                                           SignedHash hash) {
  TESSERA_RETURN_IF_ERROR(CheckS3Key(impl_->FullKey(key)));
  TESSERA_RETURN_IF_ERROR(CheckDigest({sha256, size_bytes}));
  S3Request request = impl_->RequestOf("PUT", key);
  request.headers["content-length"] = absl::StrCat(size_bytes);
  if (!upload.empty()) request.query = {{"partNumber", absl::StrCat(part)}, {"uploadId", upload}};
  request.content_sha256 = hash == SignedHash::kContent ? sha256 : kUnsignedPayload;
  if (hash == SignedHash::kContent) request.headers["x-amz-content-sha256"] = sha256;
  if (hash == SignedHash::kChecksum) {
    request.headers["x-amz-checksum-sha256"] = absl::Base64Escape(absl::HexStringToBytes(sha256));
  }
  return impl_->Sign(std::move(request), seconds);
}

void AddCounts(const std::map<std::string, S3Counts>& counts, std::map<std::string, S3Counts>* sum) {
  for (const auto& [method, more] : counts) {
    S3Counts& of_method = (*sum)[method];
    of_method.calls += more.calls;
    of_method.retries += more.retries;
    of_method.errors += more.errors;
    of_method.sent_bytes += more.sent_bytes;
    of_method.received_bytes += more.received_bytes;
    of_method.seconds += more.seconds;
  }
}

std::map<std::string, S3Counts> S3Client::counts() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->counts;
}

}  // namespace tessera
