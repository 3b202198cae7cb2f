#include "server/tesserad/logging.h"

#include <cmath>
#include <utility>

#include "absl/strings/strip.h"
#include "server/leases/worker_evidence.h"
#include "server/ledger/changed_task.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

// Fields job, tile, task, attempt, worker, kind, in this order, if known.
LogFields FieldsOf(const std::string& name, int attempt, const ChangedTask& task) {
  LogFields fields = {{"job", name.substr(0, name.find("/tasks/"))}};
  if (task.tile >= 0) fields.emplace_back("tile", std::to_string(task.tile));
  fields.emplace_back("task", name);
  if (attempt > 0) fields.emplace_back("attempt", std::to_string(attempt));
  if (!task.worker.empty()) fields.emplace_back("worker", task.worker);
  if (!task.kind.empty()) fields.emplace_back("kind", task.kind);
  return fields;
}

}  // namespace

void LogRecord(const v1::Record& record, const ChangedTask& task) {
  switch (record.change_case()) {
    case v1::Record::kJobAccepted: {
      const auto& change = record.job_accepted();
      return LogInfo("job accepted", {{"job", change.job()},
                                      {"name", change.display_name()},
                                      {"scene", change.scene_path()},
                                      {"files", std::to_string(change.scene_files_size())}});
    }
    case v1::Record::kTasksPlanned:
      return LogInfo("tasks planned", {{"job", record.tasks_planned().job()},
                                       {"tasks", std::to_string(record.tasks_planned().tasks_size())}});
    case v1::Record::kAttemptStarted: {
      const auto& change = record.attempt_started();
      return LogInfo("task leased", FieldsOf(change.task(), change.attempt(), task));
    }
    case v1::Record::kTaskSucceeded: {
      const auto& change = record.task_succeeded();
      return LogInfo(change.reused() ? "task reused" : "task succeeded",
                     FieldsOf(change.task(), change.attempt(), task));
    }
    case v1::Record::kAttemptFailed: {
      const auto& change = record.attempt_failed();
      LogFields fields = FieldsOf(change.task(), change.attempt(), task);
      fields.emplace_back("class", change.lease_expired()
                                       ? "LEASE_EXPIRED"
                                       : std::string(absl::StripPrefix(
                                             v1::ErrorClass_Name(change.error().error_class()), "ERROR_CLASS_")));
      fields.emplace_back("error", change.error().message());
      return LogEvent(change.final() ? LogLevel::kError : LogLevel::kWarning,
                      change.final() ? "task failed" : "attempt failed", fields);
    }
    case v1::Record::kJobEnded: {
      const auto& change = record.job_ended();
      return LogEvent(change.state() == v1::JOB_STATE_FAILED ? LogLevel::kError : LogLevel::kInfo, "job ended",
                      {{"job", change.job()},
                       {"state", std::string(absl::StripPrefix(v1::JobState_Name(change.state()), "JOB_STATE_"))},
                       {"error", change.error()}});
    }
    case v1::Record::kJobChanged: {
      const auto& change = record.job_changed();
      LogFields fields = {{"job", change.job()}};
      if (change.has_priority()) fields.emplace_back("priority", std::to_string(change.priority()));
      if (change.has_paused()) fields.emplace_back("paused", change.paused() ? "yes" : "no");
      return LogInfo("job changed", fields);
    }
    case v1::Record::kTileQuarantined: {
      const auto& change = record.tile_quarantined();
      return LogWarning("tile quarantined", {{"job", change.job()},
                                             {"tile", std::to_string(change.tile())},
                                             {"task", change.job() + "/tasks/" + std::to_string(change.task())}});
    }
    case v1::Record::kJobRetried: {
      const auto& change = record.job_retried();
      LogFields fields = {{"job", change.job()}};
      if (change.has_tile()) fields.emplace_back("tile", std::to_string(change.tile()));
      return LogInfo("job retried", fields);
    }
    case v1::Record::kResultLost: {
      const auto& change = record.result_lost();
      LogFields fields = FieldsOf(change.task(), 0, task);
      fields.emplace_back("reason", change.reason());
      return LogWarning("result lost: its task runs again", fields);
    }
    case v1::Record::kJobDeleted:
      return LogInfo("job deleted", {{"job", record.job_deleted().job()}, {"reason", record.job_deleted().reason()}});
    case v1::Record::kJobRestarted:
      return LogWarning(
          "job of another version restarted",
          {{"job", record.job_restarted().job()}, {"algorithm_version", record.job_restarted().algorithm_version()}});
    case v1::Record::CHANGE_NOT_SET:
      return;
  }
}

void LogWorkerSuspended(const SuspendedWorker& worker) {
  LogWarning(
      "worker suspended",
      {{"worker", worker.worker}, {"seconds", std::to_string(std::lround(worker.for_s))}, {"reason", worker.reason}});
}

void LogRecordQuarantined(int64_t number, const std::string& reason) {
  LogError("record quarantined", {{"record", std::to_string(number)}, {"reason", reason}});
}

void LogJournalStatus(const Status& trouble) {
  if (trouble.ok()) return LogInfo("journal writes succeed again: leasing resumed");
  LogError("journal write failed: leasing suspended", {{"reason", std::string(trouble.message())}});
}

}  // namespace tessera
