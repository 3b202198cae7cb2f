#include "server/ledger/dispatch_counts.h"

#include "server/ledger/ledger.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

double SecondsOf(const Attempt& attempt) {
  return attempt.end_us > attempt.start_us ? static_cast<double>(attempt.end_us - attempt.start_us) / 1e6 : 0;
}

// A worker's report is untrusted: sums must stay finite.
double Usable(double value) { return value > 0 && value < 1e12 ? value : 0; }

void CountSucceeded(const v1::TaskSucceeded& change, const JobTask& task, KindCounts& counts) {
  if (change.reused()) {
    ++counts.reused;
    return;
  }
  ++counts.succeeded;
  if (!task.attempts.empty()) counts.attempt_s += SecondsOf(task.attempts.back());
  for (const auto& output : change.outputs()) counts.output_bytes += output.digest().size_bytes();
  const double core_s = Usable(change.usage().core_seconds());
  counts.core_s += core_s;
  counts.predicted_core_s += task.plan.cost;
  if (core_s > 0 && task.plan.cost > 0) counts.core_ratio.Add(core_s / task.plan.cost);
  if (change.usage().peak_bytes() > 0 && task.plan.peak_bytes > 0) {
    counts.memory_ratio.Add(static_cast<double>(change.usage().peak_bytes()) /
                            static_cast<double>(task.plan.peak_bytes));
  }
}

}  // namespace

void DispatchCounts::Count(const v1::Record& record, const Ledger& ledger, std::optional<TaskRef> ref) {
  if (ref) {
    const JobTask& task = ledger.task(*ref);
    KindCounts& counts = kinds_[KindIndex(task.plan.kind.str())];
    if (record.has_attempt_started()) ++counts.attempts;
    if (record.has_task_succeeded()) CountSucceeded(record.task_succeeded(), task, counts);
    if (record.has_attempt_failed()) {
      const v1::AttemptFailed& change = record.attempt_failed();
      counts.attempt_s += SecondsOf(task.attempts.back());
      counts.failed += change.final() ? 1 : 0;
      ++(change.lease_expired() ? leases_expired_ : failures_[static_cast<ErrorClass>(change.error().error_class())]);
    }
    results_lost_ += record.has_result_lost() ? 1 : 0;
  }
  jobs_accepted_ += record.has_job_accepted() ? 1 : 0;
  tiles_quarantined_ += record.has_tile_quarantined() ? 1 : 0;
  if (record.has_job_ended()) ++jobs_ended_[static_cast<JobState>(record.job_ended().state())];
}

std::optional<TaskRef> TaskOf(const v1::Record& record, const Ledger& ledger) {
  const std::string* name = nullptr;
  if (record.has_attempt_started()) name = &record.attempt_started().task();
  if (record.has_task_succeeded()) name = &record.task_succeeded().task();
  if (record.has_attempt_failed()) name = &record.attempt_failed().task();
  if (record.has_result_lost()) name = &record.result_lost().task();
  if (name == nullptr) return std::nullopt;
  const StatusOr<TaskRef> ref = ledger.FindTask(*name);
  return ref.ok() ? std::optional(*ref) : std::nullopt;
}

}  // namespace tessera
