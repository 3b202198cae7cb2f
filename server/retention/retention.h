// Decides which jobs and quarantined blobs have expired.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace tessera {

struct KeptThing {
  std::string name;
  int64_t since_us = 0;  // Unix time; 0: unknown
};

// A thing expires if every call during kConfirm_s of running time found it older than `keep_s`. So a wrong clock
// deletes nothing if corrected within that time. A restart begins the confirmation again. Not thread-safe.
class Retention {
 public:
  static constexpr double kConfirm_s = 6 * 3600;

  // `keep_s`: 0 means for ever.
  explicit Retention(double keep_s) : keep_s_(keep_s) {}

  // `things`: all kept things. Returns the indices of expired ones; those of unknown age never expire.
  std::vector<int> Expired(const std::vector<KeptThing>& things, int64_t unix_us, int64_t monotonic_us);

 private:
  const double keep_s_;
  std::map<std::string, int64_t> overdue_since_us_;  // things by name, on the monotonic clock
};

}  // namespace tessera
