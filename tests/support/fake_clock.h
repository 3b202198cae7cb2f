// A clock that moves only when advanced.
#pragma once

#include <atomic>

#include "common/base/clock.h"

namespace tessera {

class FakeClock : public Clock {
 public:
  int64_t UnixTimeUs() const override { return 1'700'000'000'000'000 + elapsed_us_ + set_us_; }
  int64_t MonotonicUs() const override { return elapsed_us_; }
  void Advance(double seconds) { elapsed_us_ += static_cast<int64_t>(seconds * 1e6); }
  // As who sets the machine's time; nothing passes.
  void SetBy(double seconds) { set_us_ += static_cast<int64_t>(seconds * 1e6); }

 private:
  std::atomic<int64_t> elapsed_us_{0}, set_us_{0};
};

}  // namespace tessera
