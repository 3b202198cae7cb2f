// Sizes of pages, for all services alike.
#pragma once

#include <algorithm>
#include <cstddef>
#include <string>

#include "common/base/status.h"

namespace tessera {

inline constexpr int kMaxPage = 1000;                  // entries
inline constexpr size_t kPageBytes = size_t{2} << 20;  // a page ends at this size, below gRPC's default limit of 4 MiB

// The requested page size within its limits; `by_default` if none is requested.
inline int PageSize(int asked, int by_default) { return asked <= 0 ? by_default : std::min(asked, kMaxPage); }

// A page token is the index where the next page starts. INVALID_ARGUMENT if it is malformed; empty: `by_default`.
inline StatusOr<int> ParsePageToken(const std::string& token, int by_default) {
  if (token.empty()) return by_default;
  if (token.size() > 9 || !std::all_of(token.begin(), token.end(), [](char c) { return c >= '0' && c <= '9'; })) {
    return absl::InvalidArgumentError("malformed page token: '" + token + "'");
  }
  return std::stoi(token);
}

}  // namespace tessera
