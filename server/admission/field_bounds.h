// Bounds of the strings that callers send.
#pragma once

#include <cstddef>
#include <string>

#include "common/base/status.h"

namespace tessera {

inline constexpr size_t kMaxNameBytes = 256, kMaxPathBytes = 4096;

// INVALID_ARGUMENT if the field has more than `most` bytes.
inline Status CheckSize(const std::string& field, size_t bytes, size_t most) {
  if (bytes <= most) return absl::OkStatus();
  return InputError(field, "", std::to_string(bytes) + " bytes", "at most " + std::to_string(most));
}

}  // namespace tessera
