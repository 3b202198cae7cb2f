#include "common/s3/s3_errors.h"

#include <algorithm>
#include <cstdlib>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"
#include "absl/time/time.h"
#include "common/base/printable.h"
#include "common/base/refusal.h"

namespace tessera {
namespace {

constexpr int64_t kMaxSkewUs = int64_t{5} * 60 * 1'000'000;  // stores allow 5 to 15 minutes
constexpr size_t kMaxMessageBytes = 500;

struct CodeRow {
  const char* code;  // of the store
  absl::StatusCode status;
};

// Codes that say more than their HTTP status.
constexpr CodeRow kS3Codes[] = {
    {"NoSuchBucket", absl::StatusCode::kFailedPrecondition},
    {"PreconditionFailed", absl::StatusCode::kFailedPrecondition},
    {"RequestTimeTooSkewed", absl::StatusCode::kFailedPrecondition},
    {"InvalidAccessKeyId", absl::StatusCode::kFailedPrecondition},
    {"SignatureDoesNotMatch", absl::StatusCode::kFailedPrecondition},
    {"ExpiredToken", absl::StatusCode::kFailedPrecondition},
    {"InvalidToken", absl::StatusCode::kFailedPrecondition},
    {"TokenRefreshRequired", absl::StatusCode::kFailedPrecondition},
    {"AuthorizationHeaderMalformed", absl::StatusCode::kFailedPrecondition},
    {"QuotaExceeded", absl::StatusCode::kResourceExhausted},
    {"InsufficientCapacity", absl::StatusCode::kResourceExhausted},
    {"InsufficientStorage", absl::StatusCode::kResourceExhausted},
    {"XMinioStorageFull", absl::StatusCode::kResourceExhausted},
    {"XMinioAdminBucketQuotaExceeded", absl::StatusCode::kResourceExhausted},
    {"BadDigest", absl::StatusCode::kDataLoss},
    {"InvalidDigest", absl::StatusCode::kDataLoss},
    {"XAmzContentSHA256Mismatch", absl::StatusCode::kDataLoss},
    {"XAmzContentChecksumMismatch", absl::StatusCode::kDataLoss},
    {"SlowDown", absl::StatusCode::kUnavailable},
    {"InternalError", absl::StatusCode::kUnavailable},
    {"ServiceUnavailable", absl::StatusCode::kUnavailable},
    {"RequestTimeout", absl::StatusCode::kUnavailable},
    {"OperationAborted", absl::StatusCode::kUnavailable},
    {"ConditionalRequestConflict", absl::StatusCode::kUnavailable},
};

absl::StatusCode CodeOf(const std::string& code, int http_status) {
  for (const CodeRow& row : kS3Codes) {
    if (code == row.code) return row.status;
  }
  switch (http_status) {
    case 404:
      return absl::StatusCode::kNotFound;
    case 401:
    case 403:
      return absl::StatusCode::kPermissionDenied;
    case 412:
      return absl::StatusCode::kFailedPrecondition;
    case 408:
    case 429:
      return absl::StatusCode::kUnavailable;
    case 507:
      return absl::StatusCode::kResourceExhausted;
    case 501:
    case 505:
      return absl::StatusCode::kInvalidArgument;
    default:
      if (http_status >= 300 && http_status < 400) return absl::StatusCode::kFailedPrecondition;
      return http_status >= 500 ? absl::StatusCode::kUnavailable : absl::StatusCode::kInvalidArgument;
  }
}

// Whether the request was refused because of its time. The answer to HEAD has no code.
bool IsSkewed(const S3ErrorAnswer& error, int http_status, const HttpAnswer& answer, const S3ErrorContext& context) {
  if (error.code == "RequestTimeTooSkewed") return true;
  const std::optional<int64_t> server_us = answer.Time("date");
  return http_status == 403 && server_us && context.unix_us != 0 &&
         std::llabs(*server_us - context.unix_us) > kMaxSkewUs;
}

// What to do about the error; empty if it says so itself.
std::string Advice(const S3ErrorAnswer& error, int http_status, const HttpAnswer& answer,
                   const S3ErrorContext& context) {
  if (IsSkewed(error, http_status, answer, context)) {
    const std::optional<int64_t> server_us = answer.Time("date");
    const std::string server = server_us ? S3TimeText(*server_us) : error.server_time;
    return absl::StrCat("the clocks differ: this machine's says ", S3TimeText(context.unix_us), ", the store's ",
                        server.empty() ? "another time" : server, "; correct the clock that is wrong");
  }
  if (http_status / 100 == 3 || error.code == "AuthorizationHeaderMalformed") {
    const std::string region = error.region.empty() ? answer.Header("x-amz-bucket-region") : error.region;
    return absl::StrCat("the bucket is elsewhere", region.empty() ? "" : ", in region " + region,
                        error.endpoint.empty() ? "" : ", at " + error.endpoint,
                        "; pass its endpoint and region (--s3-endpoint, --s3-region)");
  }
  if (error.code == "NoSuchBucket") return "create the bucket, or correct its name";
  if (error.code == "ExpiredToken" || error.code == "TokenRefreshRequired") return "renew the credentials";
  if (error.code == "InvalidAccessKeyId" || error.code == "SignatureDoesNotMatch" || error.code == "InvalidToken") {
    return context.signed_url ? "ask for a new URL" : "check the credentials (AWS_ACCESS_KEY_ID or AWS_PROFILE)";
  }
  return "";
}

}  // namespace

std::string S3TimeText(int64_t unix_us) {
  return absl::FormatTime("%Y-%m-%d %H:%M:%S UTC", absl::FromUnixMicros(unix_us), absl::UTCTimeZone());
}

Status S3ErrorOf(const HttpAnswer& answer, const S3ErrorContext& context) {
  const StatusOr<S3ErrorAnswer> error = ParseS3Error(answer.body);
  return S3ErrorOf(error.ok() ? *error : S3ErrorAnswer(), answer.status, answer, context);
}

Status S3ErrorOf(const S3ErrorAnswer& error, int http_status, const HttpAnswer& answer, const S3ErrorContext& context) {
  absl::StatusCode code = CodeOf(error.code, http_status);
  if (IsSkewed(error, http_status, answer, context)) code = absl::StatusCode::kFailedPrecondition;
  const bool refused = http_status == 400 || http_status == 401 || http_status == 403;
  if (context.signed_url && refused && code == absl::StatusCode::kFailedPrecondition) {
    code = absl::StatusCode::kPermissionDenied;
  }
  const absl::string_view message = absl::StripSuffix(error.message, ".");
  std::string text = absl::StrCat(error.code.empty() ? "" : error.code + " ", "(HTTP ", http_status, ")",
                                  message.empty() ? "" : ": ", message);
  if (const std::string advice = Advice(error, http_status, answer, context); !advice.empty()) {
    absl::StrAppend(&text, ": ", advice);
  }
  for (const std::string& secret : context.secrets) {
    if (!secret.empty()) text = absl::StrReplaceAll(text, {{secret, "***"}});
  }
  Status status(code, absl::StrCat(context.object, ": ", Printable(Prefix(text, kMaxMessageBytes))));
  const std::optional<int64_t> delay_s = answer.Number("retry-after");
  if (code == absl::StatusCode::kUnavailable && delay_s) status = RetryAfter(status, static_cast<double>(*delay_s));
  return status;
}

}  // namespace tessera
