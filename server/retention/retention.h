// Which kept things have expired.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace tessera {

struct KeptThing {
  std::string name;
  int64_t since_us = 0;  // Unix time; 0: not known
};

// A thing expires once every call during kConfirm_s of running time found it older than `keep_s`. So a wrong clock
// deletes nothing if it is corrected within that time. A restart restarts the confirmation. Not thread-safe.
class Retention {
 public:
  static constexpr double kConfirm_s = 6 * 3600;

  // `keep_s`: 0: for ever.
  explicit Retention(double keep_s) : keep_s_(keep_s) {}

  // `things`: all that are kept. Returns the indices of those that have expired. Those of unknown age stay.
  std::vector<int> Expired(const std::vector<KeptThing>& things, int64_t unix_us, int64_t monotonic_us);

 private:
  const double keep_s_;
  std::map<std::string, int64_t> overdue_since_us_;  // things by name, on the monotonic clock
};

}  // namespace tessera
