// A job starts when the disk has space for its predicted output.
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "server/jobs/planning_loop.h"

namespace tessera {

// Ledger::ApplyPlanned holds a job at each plan, so none of its tasks is leased before this check. Known results are
// reused before the check and need no space. An admitted job is not held again if the prediction was too low: its tasks
// then wait for space.
void PlanningLoop::AdmitHeld() {
  {
    std::lock_guard lock(mutex_);
    if (ledger_.ready().held().empty()) return;
  }
  const std::optional<int64_t> free_bytes = environment_.blobs->FreeSpace();
  std::lock_guard lock(mutex_);
  const std::vector<int> held = ledger_.ready().held();
  Room room = {environment_.blobs->Location(), free_bytes.value_or(std::numeric_limits<int64_t>::max()), 0};
  for (const int job : ledger_.active_jobs()) {
    if (!ledger_.ready().IsHeld(job)) room.promised_bytes += BytesToStore(ledger_.jobs()[job]);
  }
  const int ready_before = ledger_.ready().count();
  for (const int job : held) {
    const int64_t needed_bytes = BytesToStore(ledger_.jobs()[job]);
    if (ledger_.jobs()[job].open_plan >= 0) continue;  // the plan is not complete
    if (needed_bytes > room.free_bytes - room.promised_bytes) continue;
    ledger_.ready().Admit(job);
    room.promised_bytes += needed_bytes;
  }
  const bool first_look = room_.folder.empty();
  room_ = std::move(room);
  const int more = ledger_.ready().count() - ready_before;
  if (more > 0 || first_look) core_.Changed();
  WakeWorkers(core_, more, ledger_.newly_ready().size());
}

}  // namespace tessera
