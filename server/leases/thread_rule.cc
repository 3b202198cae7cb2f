#include "server/leases/thread_rule.h"

#include <algorithm>

namespace tessera {

int ThreadsOfTask(const HostLoad& host, int ready, int most) {
  const int limit = std::max(1, most);
  if (host.cores <= 0) return limit;
  const int tasks = std::max(1, std::min(host.workers, host.running + ready));
  return std::clamp(host.cores / tasks, 1, limit);
}

}  // namespace tessera
