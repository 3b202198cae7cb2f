#include "server/ledger/record_owner.h"

#include "server/ledger/job.h"
#include "tessera/v1/records.pb.h"

namespace tessera {

int JobOf(const v1::Record& record) {
  switch (record.change_case()) {
    case v1::Record::kJobAccepted:
      return ParseJobName(record.job_accepted().job()).value_or(-1);
    case v1::Record::kTasksPlanned:
      return ParseJobName(record.tasks_planned().job()).value_or(-1);
    case v1::Record::kAttemptStarted:
      return ParseTaskName(record.attempt_started().task()).value_or(TaskRef()).job;
    case v1::Record::kTaskSucceeded:
      return ParseTaskName(record.task_succeeded().task()).value_or(TaskRef()).job;
    case v1::Record::kAttemptFailed:
      return ParseTaskName(record.attempt_failed().task()).value_or(TaskRef()).job;
    case v1::Record::kJobEnded:
      return ParseJobName(record.job_ended().job()).value_or(-1);
    case v1::Record::kJobChanged:
      return ParseJobName(record.job_changed().job()).value_or(-1);
    case v1::Record::kTileQuarantined:
      return ParseJobName(record.tile_quarantined().job()).value_or(-1);
    case v1::Record::kJobRetried:
      return ParseJobName(record.job_retried().job()).value_or(-1);
    case v1::Record::kResultLost:
      return ParseTaskName(record.result_lost().task()).value_or(TaskRef()).job;
    case v1::Record::kJobDeleted:
      return ParseJobName(record.job_deleted().job()).value_or(-1);
    case v1::Record::kJobRestarted:
      return ParseJobName(record.job_restarted().job()).value_or(-1);
    case v1::Record::CHANGE_NOT_SET:
      break;
  }
  return -1;
}

RecordOwner OwnerOfRecord(std::string_view content) {
  v1::Record record;
  if (!record.ParseFromArray(content.data(), static_cast<int>(content.size()))) return {};
  const int job = JobOf(record);
  return {job, job >= 0 && record.change_case() == v1::Record::kJobDeleted};
}

}  // namespace tessera
