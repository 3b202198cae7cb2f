// The history of a job's tasks.
#include <algorithm>

#include "server/jobs/dispatcher.h"

namespace tessera {
namespace {

constexpr int kMaxTasksSeen = 10'000;  // under the mutex

}  // namespace

StatusOr<AttemptPage> Dispatcher::ListAttempts(const std::string& name, int first, int number, int count) const {
  std::lock_guard lock(mutex_);
  TESSERA_ASSIGN_OR_RETURN(const int index, ledger_.FindJob(name));
  const std::deque<JobTask>& tasks = ledger_.jobs()[index].tasks;
  const int end = static_cast<int>(tasks.size());
  AttemptPage page;
  int task = std::max(0, first), next = std::max(1, number);
  for (const int limit = std::min<int64_t>(end, int64_t{task} + kMaxTasksSeen); task < limit; ++task, next = 1) {
    for (; next <= tasks[task].attempt(); ++next) {
      if (static_cast<int>(page.attempts.size()) == count) {
        page.next_task = task;
        page.next_number = next;
        return page;
      }
      const PlannedTask& plan = tasks[task].plan;
      page.attempts.push_back({{index, task}, next, plan.kind, plan.name, plan.tile, tasks[task].attempts[next - 1]});
    }
  }
  if (task < end) page.next_task = task;
  return page;
}

}  // namespace tessera
