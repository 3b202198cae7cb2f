#include "common/base/status_parts.h"

#include <cstdlib>

#include "absl/strings/cord.h"

namespace tessera {
namespace {

std::string UrlOf(const std::string& kind) { return "type.tessera/" + kind; }

}  // namespace

// Encoding: each part is its length in bytes, a colon and its bytes.
void SetParts(Status& error, const std::string& kind, const std::vector<std::string>& parts) {
  std::string bytes;
  for (const std::string& part : parts) bytes += std::to_string(part.size()) + ":" + part;
  error.SetPayload(UrlOf(kind), absl::Cord(bytes));
}

std::vector<std::string> PartsOf(const Status& status, const std::string& kind) {
  std::vector<std::string> parts;
  const auto payload = status.GetPayload(UrlOf(kind));
  if (!payload) return parts;
  const std::string bytes(*payload);
  for (size_t at = 0; at < bytes.size();) {
    const size_t colon = bytes.find(':', at);
    const size_t size = std::strtoull(bytes.c_str() + at, nullptr, 10);
    parts.push_back(bytes.substr(colon + 1, size));
    at = colon + 1 + size;
  }
  return parts;
}

}  // namespace tessera
