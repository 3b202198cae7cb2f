// Limits of requests that all services share.
#ifndef TESSERA_SERVER_GRPC_REQUEST_BOUNDS_H_
#define TESSERA_SERVER_GRPC_REQUEST_BOUNDS_H_

#include <algorithm>
#include <string>

#include "common/base/status.h"

namespace tessera {

inline constexpr size_t kMaxNameBytes = 256, kMaxPathBytes = 4096;
inline constexpr int kMaxPage = 1000;                  // entries
inline constexpr size_t kPageBytes = size_t{2} << 20;  // a page ends at this size, below gRPC's default limit of 4 MiB

// The requested page size within its limits; `by_default` if none is requested.
inline int PageSize(int asked, int by_default) { return asked <= 0 ? by_default : std::min(asked, kMaxPage); }

// INVALID_ARGUMENT if the field has more than `most` bytes.
inline Status CheckSize(const std::string& field, size_t bytes, size_t most) {
  if (bytes <= most) return absl::OkStatus();
  return InputError(field, "", std::to_string(bytes) + " bytes", "at most " + std::to_string(most));
}

}  // namespace tessera

#endif  // TESSERA_SERVER_GRPC_REQUEST_BOUNDS_H_
