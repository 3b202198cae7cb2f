// Time, passed in: nothing below a main() asks the machine for it.
#ifndef TESSERA_COMMON_BASE_CLOCK_H_
#define TESSERA_COMMON_BASE_CLOCK_H_

#include <chrono>
#include <cstdint>

namespace tessera {

// Thread-safe.
class Clock {
 public:
  virtual ~Clock() = default;
  // Microseconds since 1970-01-01 UTC; may jump when the machine's time is set. For what is stored and shown.
  virtual int64_t UnixTimeUs() const = 0;
  // Microseconds since some fixed moment; never goes back. For leases and rates.
  virtual int64_t MonotonicUs() const = 0;
};

// The machine's own clocks.
class SystemClock : public Clock {
 public:
  int64_t UnixTimeUs() const override {
    return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
        .count();
  }
  int64_t MonotonicUs() const override {
    return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
  }
};

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_CLOCK_H_
