// Sizes of pages, for all services alike.
#pragma once

#include <algorithm>
#include <cstddef>

namespace tessera {

inline constexpr int kMaxPage = 1000;                  // entries
inline constexpr size_t kPageBytes = size_t{2} << 20;  // a page ends at this size, below gRPC's default limit of 4 MiB

// The requested page size within its limits; `by_default` if none is requested.
inline int PageSize(int asked, int by_default) { return asked <= 0 ? by_default : std::min(asked, kMaxPage); }

}  // namespace tessera
