#include "server/leases/thread_rule.h"

#include <algorithm>

namespace tessera {

int ThreadsOfTask(const MachineLoad& machine, int ready, int most) {
  const int limit = std::max(1, most);
  if (machine.cores <= 0) return limit;
  const int tasks = std::max(1, std::min(machine.workers, machine.running + ready));
  return std::clamp(machine.cores / tasks, 1, limit);
}

}  // namespace tessera
