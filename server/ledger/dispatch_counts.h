// Counters since the start of the coordinator, for its metrics.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>

#include "server/store/histogram.h"
#include "server/ledger/job.h"
#include "server/ledger/task_groups.h"

namespace tessera {

namespace v1 {
class Record;
}  // namespace v1
class Ledger;

// Counters of all tasks of one kind.
struct KindCounts {
  int64_t attempts = 0;             // attempts started
  int64_t succeeded = 0;            // tasks that ran
  int64_t reused = 0;               // tasks whose result was found under their key
  int64_t failed = 0;               // tasks that failed permanently
  double attempt_s = 0;             // wall time of attempts that succeeded or failed
  double core_s = 0;                // processor time of tasks that succeeded
  double predicted_core_s = 0;      // predicted processor time of the same tasks
  int64_t output_bytes = 0;         // of tasks that succeeded
  Histogram core_ratio = Ratios();  // used / predicted, of tasks with both numbers
  Histogram memory_ratio = Ratios();

  static Histogram Ratios() { return Histogram({0.1, 0.25, 0.5, 0.75, 0.9, 1, 1.1, 1.25, 1.5, 2, 4, 10}); }
};

// Counts committed records. Not thread-safe.
class DispatchCounts {
 public:
  // `record`: already applied to the ledger; `ref`: its TaskOf.
  void Count(const v1::Record& record, const Ledger& ledger, std::optional<TaskRef> ref);
  void CountSuspended(int64_t workers) { workers_suspended_ += workers; }

  const std::array<KindCounts, kTaskKindSlots>& kinds() const { return kinds_; }
  // Failed attempts by class, without those whose lease expired (leases_expired).
  const std::map<ErrorClass, int64_t>& failures() const { return failures_; }
  int64_t leases_expired() const { return leases_expired_; }
  int64_t jobs_accepted() const { return jobs_accepted_; }
  const std::map<JobState, int64_t>& jobs_ended() const { return jobs_ended_; }
  int64_t tiles_quarantined() const { return tiles_quarantined_; }
  int64_t results_lost() const { return results_lost_; }
  int64_t workers_suspended() const { return workers_suspended_; }

 private:
  std::array<KindCounts, kTaskKindSlots> kinds_;
  std::map<ErrorClass, int64_t> failures_;
  std::map<JobState, int64_t> jobs_ended_;
  int64_t leases_expired_ = 0, jobs_accepted_ = 0, tiles_quarantined_ = 0, results_lost_ = 0, workers_suspended_ = 0;
};

// The task that the record changes; none if it changes a job.
std::optional<TaskRef> TaskOf(const v1::Record& record, const Ledger& ledger);

}  // namespace tessera
