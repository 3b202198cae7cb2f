// Elapsed time in seconds.
#pragma once

#include <cstdint>

#include "common/base/clock.h"

namespace tessera {

// Seconds since `start_us`, an earlier MonotonicUs() of the same clock.
inline double SecondsSince(const Clock& clock, int64_t start_us) {
  return 1e-6 * static_cast<double>(clock.MonotonicUs() - start_us);
}

}  // namespace tessera
