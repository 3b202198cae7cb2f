#include "common/s3/object_stream.h"

#include <charconv>
#include <optional>

#include "absl/strings/str_cat.h"
#include "common/s3/s3_answers.h"

namespace tessera {
namespace {

// Reads a number of at least 0 and removes it from `text`.
std::optional<int64_t> TakeNumber(std::string_view* text) {
  int64_t value = 0;
  const auto [stop, error] = std::from_chars(text->data(), text->data() + text->size(), value);
  if (error != std::errc() || value < 0) return std::nullopt;
  text->remove_prefix(static_cast<size_t>(stop - text->data()));
  return value;
}

bool TakeWord(std::string_view word, std::string_view* text) {
  if (!text->starts_with(word)) return false;
  text->remove_prefix(word.size());
  return true;
}

}  // namespace

StatusOr<ObjectRange> RangeOf(const HttpAnswer& answer, int64_t offset_bytes) {
  if (answer.status != 206) {
    const std::optional<int64_t> total = answer.Number("content-length");
    if (!total) return absl::InternalError("the store's answer does not say its length");
    if (offset_bytes > 0) return absl::InternalError("the store ignores the header Range");
    return ObjectRange{*total, *total};
  }
  // bytes FIRST-LAST/TOTAL
  std::string_view text = answer.Header("content-range");
  const bool unit = TakeWord("bytes ", &text);
  const std::optional<int64_t> first = TakeNumber(&text);
  const bool dash = TakeWord("-", &text);
  const std::optional<int64_t> last = TakeNumber(&text);
  const bool slash = TakeWord("/", &text);
  const std::optional<int64_t> total = TakeNumber(&text);
  if (!unit || !first || !dash || !last || !slash || !total || !text.empty() || *first != offset_bytes ||
      *last < *first || *last >= *total) {
    return absl::InternalError(absl::StrCat("the store's answer has a wrong Content-Range for offset ", offset_bytes));
  }
  return ObjectRange{*last + 1, *total};
}

Status StreamObject(const std::string& what, const SendGet& send, int64_t offset_bytes, const RetryPolicy& policy,
                    const Sleeper& sleeper, const std::function<Status(std::string_view bytes)>& take) {
  const auto changed = [&] { return absl::AbortedError(what + ": the object changed while it was read"); };
  Backoff backoff(policy);
  int64_t position = offset_bytes;
  std::optional<int64_t> total;
  std::string etag;
  for (int attempt = 1;; ++attempt) {
    HttpHeaders headers;
    if (position > 0) headers["range"] = absl::StrCat("bytes=", position, "-");
    if (!etag.empty()) headers["if-match"] = absl::StrCat("\"", etag, "\"");
    Status fault;  // not to be retried
    const auto check = [&](const HttpAnswer& head) -> Status {
      const StatusOr<ObjectRange> range = RangeOf(head, position);
      if (!range.ok()) return absl::InternalError(absl::StrCat(what, ": ", std::string(range.status().message())));
      const std::string now = ParseEtag(head.Header("etag")).value_or("");
      if (total && (now != etag || now.empty() || range->total_bytes != *total)) return changed();
      etag = now;
      total = range->total_bytes;
      return absl::OkStatus();
    };
    bool checked = false;
    const StatusOr<HttpAnswer> answer = send(headers, [&](const HttpAnswer& head, std::string_view bytes) -> Status {
      if (!checked) fault = check(head);
      checked = true;
      if (fault.ok() && static_cast<int64_t>(bytes.size()) > *total - position) {
        fault = absl::InternalError(what + ": the store sent more bytes than it said");
      }
      if (fault.ok()) fault = take(bytes);
      if (!fault.ok()) return fault;
      position += static_cast<int64_t>(bytes.size());
      attempt = 0;
      backoff.Reset();
      return absl::OkStatus();
    });
    if (!fault.ok()) return fault;
    Status status = answer.status();
    if (answer.ok()) {
      if (answer->status == 412 || (answer->status == 416 && total)) return changed();
      if (answer->status == 416) return absl::OkStatus();  // the object has no byte at the offset
      if (!checked) TESSERA_RETURN_IF_ERROR(check(*answer));
      if (position == *total) return absl::OkStatus();
      status = absl::UnavailableError(absl::StrCat(what, ": the store sent ", position, " of ", *total, " bytes"));
    }
    if (!IsTransient(status, Idempotency::kOnce)) return status;
    if (policy.max_attempts > 0 && attempt >= policy.max_attempts) return status;
    if (!sleeper(backoff.NextDelay(status))) return absl::CancelledError("cancelled while waiting for the store");
  }
}

}  // namespace tessera
