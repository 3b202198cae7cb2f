// What has been kept for long enough.
#ifndef TESSERA_SERVER_RETENTION_RETENTION_H_
#define TESSERA_SERVER_RETENTION_RETENTION_H_

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace tessera {

struct KeptThing {
  std::string name;
  int64_t since_us = 0;  // Unix time; 0: not known
};

// A thing goes when the machine's clock has said for kConfirm_s of running time, at every look, that it has been kept
// for more than `keep_s`: a clock that is set wrong deletes nothing if it is set right within that time. A restart
// begins the confirmation anew. Not thread-safe.
class Retention {
 public:
  static constexpr double kConfirm_s = 6 * 3600;

  // `keep_s`: 0: for ever.
  explicit Retention(double keep_s) : keep_s_(keep_s) {}

  // A look at all that is kept. Gives the places in `things` of those that are to go. Those of which it is not known
  // since when they are kept stay.
  std::vector<int> Expired(const std::vector<KeptThing>& things, int64_t unix_us, int64_t monotonic_us);

 private:
  const double keep_s_;
  std::map<std::string, int64_t> overdue_since_us_;  // things by name, on the monotonic clock
};

}  // namespace tessera

#endif  // TESSERA_SERVER_RETENTION_RETENTION_H_
