// Check and Apply by kind of record, and changes of priority and pause.
#include "server/ledger/ledger.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

constexpr int64_t kLastTimeUs = 253'402'300'799'999'999;  // end of the year 9999: differences of times cannot overflow

}  // namespace

Status Ledger::Check(const v1::Record& record) const {
  if (record.time_us() < 0 || record.time_us() > kLastTimeUs) {
    return absl::InvalidArgumentError("time of the record out of range: " + std::to_string(record.time_us()) + " us");
  }
  switch (record.change_case()) {
    case v1::Record::kJobAccepted:
      return CheckAccepted(record.job_accepted());
    case v1::Record::kTasksPlanned:
      return CheckPlanned(record.tasks_planned());
    case v1::Record::kAttemptStarted:
      return CheckStarted(record.attempt_started());
    case v1::Record::kTaskSucceeded:
      return CheckSucceeded(record.task_succeeded());
    case v1::Record::kAttemptFailed:
      return CheckFailed(record.attempt_failed());
    case v1::Record::kJobEnded:
      return CheckEnded(record.job_ended());
    case v1::Record::kJobChanged:
      return CheckChanged(record.job_changed());
    case v1::Record::kTileQuarantined:
      return CheckQuarantined(record.tile_quarantined());
    case v1::Record::kJobRetried:
      return CheckRetried(record.job_retried());
    case v1::Record::kResultLost:
      return CheckLost(record.result_lost());
    case v1::Record::kJobDeleted:
      return CheckDeleted(record.job_deleted());
    case v1::Record::kJobRestarted:
      return CheckRestarted(record.job_restarted());
    case v1::Record::CHANGE_NOT_SET:
      break;
  }
  return absl::InvalidArgumentError("unknown kind of record");
}

void Ledger::Apply(const v1::Record& record) {
  ready_.NoteTime(record.time_us());
  switch (record.change_case()) {
    case v1::Record::kJobAccepted:
      return ApplyAccepted(record.job_accepted(), record.time_us());
    case v1::Record::kTasksPlanned:
      return ApplyPlanned(record.tasks_planned());
    case v1::Record::kAttemptStarted:
      return ApplyStarted(record.attempt_started(), record.time_us());
    case v1::Record::kTaskSucceeded:
      return ApplySucceeded(record.task_succeeded(), record.time_us());
    case v1::Record::kAttemptFailed:
      return ApplyFailed(record.attempt_failed(), record.time_us());
    case v1::Record::kJobEnded:
      return ApplyEnded(record.job_ended(), record.time_us());
    case v1::Record::kJobChanged:
      return ApplyChanged(record.job_changed());
    case v1::Record::kTileQuarantined:
      return ApplyQuarantined(record.tile_quarantined());
    case v1::Record::kJobRetried:
      return ApplyRetried(record.job_retried());
    case v1::Record::kResultLost:
      return ApplyLost(record.result_lost());
    case v1::Record::kJobDeleted:
      return ApplyDeleted(record.job_deleted());
    case v1::Record::kJobRestarted:
      return ApplyRestarted(record.job_restarted());
    case v1::Record::CHANGE_NOT_SET:
      return;
  }
}

Status Ledger::CheckChanged(const v1::JobChanged& change) const {
  TESSERA_ASSIGN_OR_RETURN(const int index, FindJob(change.job()));
  if (HasEnded(jobs_[index].header.state)) return absl::FailedPreconditionError(change.job() + " has ended");
  return CheckPriority(change.priority());
}

void Ledger::ApplyChanged(const v1::JobChanged& change) {
  const int index = *FindJob(change.job());
  JobHeader& header = jobs_[index].header;
  if (change.has_priority()) header.priority = change.priority();
  if (change.has_paused()) header.paused = change.paused();
  ready_.SetJob(index, header.priority, header.paused);
}

}  // namespace tessera
