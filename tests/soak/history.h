// Ordered log of a soak, with its clock.
#pragma once

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <deque>
#include <fstream>
#include <stdexcept>
#include <string>

#include "common/base/random.h"

namespace tessera::soak {

// A violated guarantee of the product.
struct Violation : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// The numbers of one step of a soak: those that its seed, the step's place and whose it is give, whatever else
// happened.
inline Random RandomOf(uint64_t seed, char whose, int step) {
  return Random(MixBits(MixBits(seed) + static_cast<uint64_t>(whose)) + static_cast<uint64_t>(step));
}

class History {
 public:
  explicit History(const std::string& path) : file_(path) {}

  // Seconds since the start.
  double Now_s() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }
  void Note(const std::string& what) {
    constexpr size_t kLast = 15;
    char time[32];
    std::snprintf(time, sizeof(time), "%8.2f s  ", Now_s());
    file_ << time << what << std::endl;
    last_.push_back(time + what);
    if (last_.size() > kLast) last_.pop_front();
    ++steps_;
  }
  const std::deque<std::string>& last() const { return last_; }
  int steps() const { return steps_; }

 private:
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::ofstream file_;
  std::deque<std::string> last_;
  int steps_ = 0;
};

}  // namespace tessera::soak
