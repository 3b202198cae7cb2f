#include "server/metrics/dispatch_snapshot.h"

#include <algorithm>

#include "server/leases/dispatch_core.h"

namespace tessera {

DispatchSnapshot SnapshotOf(DispatchCore& core) {
  DispatchSnapshot snapshot;
  snapshot.journal = core.journal().stats();
  snapshot.can_store = core.journal().trouble().ok();
  std::lock_guard lock(core.mutex());
  snapshot.counts = core.counts();
  const ReadyTasks& ready = core.ledger().ready();
  snapshot.ready = ready.Groups();
  snapshot.wanted = DemandOf(core.ledger(), DefaultClasses(), kWorth_s).classes;
  snapshot.delayed = ready.delayed_count();
  if (const auto since_us = ready.OldestSince()) {
    const int64_t now_us = core.environment().clock->UnixTimeUs();
    snapshot.oldest_ready_s = std::max(0.0, static_cast<double>(now_us - *since_us) / 1e6);
  }
  for (const int index : core.ledger().active_jobs()) {
    const Job& job = core.ledger().jobs()[index];
    snapshot.unfinished += job.unfinished;
    snapshot.jobs_held += ready.IsHeld(index) ? 1 : 0;
    ++(job.header.paused                       ? snapshot.jobs_paused
       : job.header.state == JobState::kQueued ? snapshot.jobs_queued
                                               : snapshot.jobs_running);
  }
  for (const auto& [ref, lease] : core.lease_table().leases())
    ++snapshot.leases[KindIndex(core.ledger().task(ref).plan.kind.str())];
  const int64_t monotonic_us = core.environment().clock->MonotonicUs();
  for (const auto& [name, worker] : core.lease_table().workers()) {
    const bool silent = monotonic_us - worker.last_seen_us > Micros(core.options().lease_s);
    ++(silent                              ? snapshot.workers_silent
       : IsSuspended(worker, monotonic_us) ? snapshot.workers_suspended
       : worker.tasks.empty()              ? snapshot.workers_idle
                                           : snapshot.workers_working);
  }
  return snapshot;
}

}  // namespace tessera
