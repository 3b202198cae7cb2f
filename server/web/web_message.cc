#include "server/web/web_message.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "common/base/refusal.h"

namespace tessera {
namespace {

constexpr char kJsonType[] = "application/json; charset=utf-8";
constexpr int kRetry_s = 1;  // if the error does not say

int HexValue(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

}  // namespace

std::optional<std::string> WebRequest::Header(std::string_view name) const {
  const std::string* found = nullptr;
  for (const auto& [key, value] : headers) {
    if (!absl::EqualsIgnoreCase(key, absl::string_view(name.data(), name.size()))) continue;
    if (found != nullptr) return std::nullopt;
    found = &value;
  }
  return found == nullptr ? std::nullopt : std::optional(*found);
}

int HttpStatusOf(absl::StatusCode code) {
  switch (code) {
    case absl::StatusCode::kOk:
      return 200;
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kOutOfRange:
      return 400;
    case absl::StatusCode::kUnauthenticated:
      return 401;
    case absl::StatusCode::kPermissionDenied:
      return 403;
    case absl::StatusCode::kNotFound:
      return 404;
    case absl::StatusCode::kAlreadyExists:
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kAborted:
      return 409;
    case absl::StatusCode::kResourceExhausted:
      return 429;
    case absl::StatusCode::kUnimplemented:
      return 501;
    case absl::StatusCode::kUnavailable:
      return 503;
    case absl::StatusCode::kDeadlineExceeded:
      return 504;
    default:
      return 500;
  }
}

WebAnswer ErrorAnswer(int http_status, std::string_view code, std::string_view message) {
  WebAnswer answer;
  answer.status = http_status;
  answer.type = kJsonType;
  const nlohmann::json json = {{"code", code}, {"message", message}};
  answer.body = json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  if (http_status == 429 || http_status == 503) answer.headers.emplace_back("Retry-After", std::to_string(kRetry_s));
  return answer;
}

WebAnswer ErrorAnswer(const Status& status) {
  const std::string name(absl::StatusCodeToString(status.code()));
  WebAnswer answer = ErrorAnswer(HttpStatusOf(status.code()), name, std::string(status.message()));
  if (const double delay_s = RetryDelayOf(status); delay_s > 0) {
    std::erase_if(answer.headers, [](const auto& header) { return header.first == "Retry-After"; });
    answer.headers.emplace_back("Retry-After", std::to_string(static_cast<int>(std::ceil(delay_s))));
  }
  return answer;
}

WebAnswer JsonAnswer(std::string json) {
  WebAnswer answer;
  answer.type = kJsonType;
  answer.body = std::move(json);
  return answer;
}

StatusOr<std::string> DecodedPath(std::string_view raw) {
  const auto refused = absl::NotFoundError("no such path");
  std::string path;
  for (size_t i = 0; i < raw.size(); ++i) {
    char c = raw[i];
    if (c == '%') {
      if (i + 2 >= raw.size()) return refused;
      const int high = HexValue(raw[i + 1]), low = HexValue(raw[i + 2]);
      if (high < 0 || low < 0) return refused;
      c = static_cast<char>(16 * high + low);
      i += 2;
      if (c == '/') return refused;
    }
    const auto byte = static_cast<unsigned char>(c);
    if (byte < 0x20 || byte == 0x7f || c == '\\') return refused;
    path += c;
  }
  if (!path.starts_with('/')) return refused;
  const std::vector<std::string> parts = absl::StrSplit(path.substr(1), '/');
  for (size_t i = 0; i < parts.size(); ++i) {
    const bool last = i + 1 == parts.size();
    if (parts[i] == "." || parts[i] == ".." || (parts[i].empty() && !last)) return refused;
  }
  return path;
}

}  // namespace tessera
