#include "server/jobs/dispatch_snapshot.h"

#include <algorithm>

#include "server/jobs/dispatcher.h"

namespace tessera {

DispatchSnapshot Dispatcher::Snapshot() const {
  DispatchSnapshot snapshot;
  snapshot.journal = journal_.stats();
  snapshot.can_store = journal_.trouble().ok();
  std::lock_guard lock(mutex_);
  snapshot.counts = counts_;
  const ReadyTasks& ready = ledger_.ready();
  snapshot.ready = ready.Groups();
  snapshot.delayed = ready.delayed_count();
  if (const auto since_us = ready.OldestSince()) {
    const int64_t now_us = environment_.clock->UnixTimeUs();
    snapshot.oldest_ready_s = std::max(0.0, static_cast<double>(now_us - *since_us) / 1e6);
  }
  for (const int index : ledger_.active_jobs()) {
    const Job& job = ledger_.jobs()[index];
    snapshot.unfinished += job.unfinished;
    snapshot.jobs_held += ready.IsHeld(index) ? 1 : 0;
    ++(job.header.paused                       ? snapshot.jobs_paused
       : job.header.state == JobState::kQueued ? snapshot.jobs_queued
                                               : snapshot.jobs_running);
  }
  for (const auto& [ref, lease] : leases_.leases()) ++snapshot.leases[KindIndex(ledger_.task(ref).plan.kind.str())];
  const int64_t monotonic_us = environment_.clock->MonotonicUs();
  for (const auto& [name, worker] : leases_.workers()) {
    const bool silent = monotonic_us - worker.last_seen_us > Micros(options_.lease_s);
    ++(silent                             ? snapshot.workers_silent
       : IsSetAside(worker, monotonic_us) ? snapshot.workers_set_aside
       : worker.tasks.empty()             ? snapshot.workers_idle
                                          : snapshot.workers_working);
  }
  return snapshot;
}

}  // namespace tessera
