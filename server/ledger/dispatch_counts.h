// Counts of a coordinator since it was started.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>

#include "common/base/histogram.h"
#include "server/ledger/job.h"
#include "server/ledger/task_groups.h"

namespace tessera {

namespace v1 {
class Record;
}  // namespace v1
class Ledger;

// Of all tasks of a kind.
struct KindCounts {
  int64_t attempts = 0;             // started
  int64_t succeeded = 0;            // that ran
  int64_t reused = 0;               // taken from a known result
  int64_t failed = 0;               // for good
  double attempt_s = 0;             // of attempts that succeeded or failed
  double core_s = 0;                // processor time of those that succeeded
  double predicted_core_s = 0;      // of the same
  int64_t output_bytes = 0;         // of those that succeeded
  Histogram core_ratio = Ratios();  // used / predicted, of those of which both are known
  Histogram memory_ratio = Ratios();

  static Histogram Ratios() { return Histogram({0.1, 0.25, 0.5, 0.75, 0.9, 1, 1.1, 1.25, 1.5, 2, 4, 10}); }
};

// Adds up records as they are committed. Not thread-safe.
class DispatchCounts {
 public:
  // `record`: applied to the ledger; `ref`: TaskOf it.
  void Count(const v1::Record& record, const Ledger& ledger, std::optional<TaskRef> ref);
  void CountSuspended(int64_t workers) { workers_suspended_ += workers; }

  const std::array<KindCounts, kTaskKindSlots>& kinds() const { return kinds_; }
  // Attempts that failed, by class; those whose lease expired are counted there alone.
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

// The task that the record is about; none if it is about a job.
std::optional<TaskRef> TaskOf(const v1::Record& record, const Ledger& ledger);

}  // namespace tessera
