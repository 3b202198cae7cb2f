#include "common/s3/s3_location.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"

namespace tessera {
namespace {

constexpr char kScheme[] = "s3://";

bool IsBucketName(const std::string& name) {
  const auto edge = [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'); };
  return name.size() >= 3 && name.size() <= 63 && edge(name.front()) && edge(name.back()) &&
         std::all_of(name.begin(), name.end(), [&](char c) { return edge(c) || c == '-' || c == '.'; });
}

bool IsPrintableWord(const std::string& text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return c > ' ' && c < 127; });
}

// Without a slash at the end and the scheme's own port, which HTTP clients leave out of the header Host.
StatusOr<std::string> CheckEndpoint(const std::string& endpoint) {
  const Status error = InputError("S3 endpoint", "", absl::StrCat("'", Printable(endpoint), "'"),
                                  "http://HOST[:PORT] or https://HOST[:PORT], without a path");
  std::string own_port;
  if (endpoint.starts_with("http://")) own_port = ":80";
  if (endpoint.starts_with("https://")) own_port = ":443";
  if (own_port.empty() || !IsPrintableWord(endpoint)) return error;
  std::string text = endpoint;
  if (text.ends_with("/")) text.pop_back();
  const std::string host = text.substr(text.find("://") + 3);
  if (host.empty() || host.find_first_of("/?#@\\%\"") != std::string::npos) return error;
  if (text.ends_with(own_port)) text.resize(text.size() - own_port.size());
  return text;
}

}  // namespace

bool IsS3Url(const std::string& url) { return url.starts_with(kScheme); }

StatusOr<S3Location> ParseS3Url(const std::string& url, const std::string& endpoint, const std::string& region) {
  const std::string quoted = absl::StrCat("'", Printable(url), "'");
  if (!IsS3Url(url)) return InputError("S3 URL", "", quoted, "s3://BUCKET[/PREFIX]");
  S3Location location;
  if (!region.empty()) location.region = region;
  if (!IsPrintableWord(location.region) || location.region.find('/') != std::string::npos) {
    return InputError("S3 region", "", absl::StrCat("'", Printable(region), "'"), "a name such as us-east-1");
  }
  const std::string path = url.substr(sizeof(kScheme) - 1);
  location.bucket = path.substr(0, path.find('/'));
  if (!IsBucketName(location.bucket)) {
    return InputError("S3 URL", "", quoted, "a bucket of 3 to 63 lower-case letters, digits, '-' and '.'");
  }
  if (path.size() > location.bucket.size()) location.prefix = path.substr(location.bucket.size() + 1);
  if (!location.prefix.empty() && !location.prefix.ends_with("/")) location.prefix += "/";
  TESSERA_RETURN_IF_ERROR(CheckS3Key(location.prefix + "key"));
  const std::string host = absl::StrCat("https://s3.", location.region, ".amazonaws.com");
  TESSERA_ASSIGN_OR_RETURN(location.endpoint, CheckEndpoint(endpoint.empty() ? host : endpoint));
  return location;
}

Status CheckS3Key(const std::string& key) {
  const auto is_control = [](unsigned char c) { return c < ' ' || c == 127; };
  if (!key.empty() && key.size() <= 1024 && IsUtf8(key) && std::none_of(key.begin(), key.end(), is_control) &&
      absl::StrCat("/", key, "/").find("//") == std::string::npos &&
      absl::StrCat("/", key, "/").find("/./") == std::string::npos &&
      absl::StrCat("/", key, "/").find("/../") == std::string::npos) {
    return absl::OkStatus();
  }
  return InputError("S3 key", "", absl::StrCat("'", Printable(Prefix(key, 100)), "'"),
                    "at most 1,024 bytes of UTF-8 without control characters, empty parts, '.' and '..'");
}

std::string ToText(const S3Location& location) {
  return absl::StrCat(kScheme, location.bucket, "/", Printable(location.prefix));
}

}  // namespace tessera
