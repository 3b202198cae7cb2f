// Interface to the system's clocks. It is passed in, so that tests can use a fake clock; only main() makes a
// SystemClock.
#pragma once

#include <chrono>
#include <cstdint>

namespace tessera {

// Thread-safe.
class Clock {
 public:
  virtual ~Clock() = default;
  // Microseconds since 1970-01-01 UTC, for times that are stored or displayed. May jump when the system time is set.
  virtual int64_t UnixTimeUs() const = 0;
  // Microseconds since an arbitrary fixed time, for leases and rates. Never decreases.
  virtual int64_t MonotonicUs() const = 0;
};

// The clocks of the operating system.
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
