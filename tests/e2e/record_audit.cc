#include "tests/e2e/record_audit.h"

#include <stdexcept>

#include "server/store/sqlite_store.h"
#include "server/store/state_store.h"
#include "tessera/v1/records.pb.h"

namespace tessera::e2e {

void RecordAudit::Fault(const std::string& what) {
  faults_.push_back("record " + std::to_string(records_) + ": " + what);
}

void RecordAudit::Expect(bool holds, const std::string& what) {
  if (!holds) Fault(what);
}

RecordAudit::Job& RecordAudit::JobOf(const std::string& task) { return jobs_[task.substr(0, task.find("/tasks/"))]; }

RecordAudit::Task& RecordAudit::TaskOf(const std::string& name) { return JobOf(name).tasks[name]; }

void RecordAudit::Add(const v1::Record& record) {
  ++records_;
  switch (record.change_case()) {
    case v1::Record::kJobAccepted: {
      const auto& change = record.job_accepted();
      Expect(!jobs_.contains(change.job()), change.job() + " was accepted twice");
      for (const auto& [name, job] : jobs_) {
        Expect(job.request_id.empty() || job.request_id != change.request_id(),
               change.job() + " and " + name + " are of one request");
      }
      jobs_[change.job()].request_id = change.request_id();
      break;
    }
    case v1::Record::kTasksPlanned: {
      const auto& change = record.tasks_planned();
      Expect(jobs_[change.job()].state == 0, change.job() + " was planned after its end");
      for (int i = 0; i < change.tasks_size(); ++i) {
        jobs_[change.job()].kinds[change.first_task() + i] = change.tasks(i).kind();
      }
      for (const int task : change.superseded()) TaskOf(change.job() + "/tasks/" + std::to_string(task)).runs = false;
      break;
    }
    case v1::Record::kAttemptStarted: {
      const auto& change = record.attempt_started();
      Task& task = TaskOf(change.task());
      const std::string what = change.task() + ", attempt " + std::to_string(change.attempt());
      Expect(!task.runs, what + " began while another runs");
      Expect(!task.done, what + " began though there is a result");
      Expect(change.attempt() == task.attempts + 1,
             what + " began after attempt " + std::to_string(task.attempts) + " of it");
      task.attempts = change.attempt();
      task.runs = true;
      break;
    }
    case v1::Record::kAttemptFailed: {
      const auto& change = record.attempt_failed();
      Task& task = TaskOf(change.task());
      Expect(task.runs && change.attempt() == task.attempts,
             change.task() + ", attempt " + std::to_string(change.attempt()) + " failed but does not run");
      task.runs = false;
      failures_[change.lease_expired() ? "silence" : v1::ErrorClass_Name(change.error().error_class())].push_back(
          change.task() + ": " + change.error().message());
      break;
    }
    case v1::Record::kTaskSucceeded: {
      const auto& change = record.task_succeeded();
      Task& task = TaskOf(change.task());
      const std::string what = change.task() + ", attempt " + std::to_string(change.attempt());
      Expect(!task.done, what + " succeeded though there is a result already");
      Expect(change.reused() ? !task.runs : task.runs && change.attempt() == task.attempts,
             what + " succeeded but is not the one that runs");
      std::map<std::string, std::string> outputs;
      for (const auto& output : change.outputs()) outputs[output.name()] = output.digest().sha256();
      Expect(task.successes == 0 || outputs == task.outputs, what + " made again other bytes than before");
      task.outputs = std::move(outputs);
      task.done = true;
      task.runs = false;
      ++task.successes;
      break;
    }
    case v1::Record::kJobEnded: {
      const auto& change = record.job_ended();
      Job& job = jobs_[change.job()];
      Expect(job.state == 0, change.job() + " ended twice");
      job.state = change.state();
      ++job.ends;
      for (auto& [name, task] : job.tasks) task.runs = false;
      break;
    }
    case v1::Record::kJobRetried: {
      Job& job = jobs_[record.job_retried().job()];
      Expect(job.state == v1::JOB_STATE_FAILED || job.state == v1::JOB_STATE_PARTIAL,
             record.job_retried().job() + " was tried again but has not failed");
      job.state = 0;
      break;
    }
    case v1::Record::kResultLost: {
      TaskOf(record.result_lost().task()).done = false;
      break;
    }
    case v1::Record::kJobRestarted: {
      Job& job = jobs_[record.job_restarted().job()];
      Expect(job.state == 0, record.job_restarted().job() + " began anew after its end");
      job.tasks.clear();
      job.kinds.clear();
      break;
    }
    case v1::Record::kJobDeleted: {
      Expect(jobs_[record.job_deleted().job()].state != 0, record.job_deleted().job() + " was deleted before its end");
      jobs_.erase(record.job_deleted().job());
      break;
    }
    case v1::Record::kJobChanged:
    case v1::Record::kTileQuarantined:
      break;
    case v1::Record::CHANGE_NOT_SET:
      Fault("of no known kind");
      break;
  }
}

RecordAudit AuditRecords(const std::string& state) {
  RecordAudit audit;
  std::unique_ptr<StateStore> store;
  if (IsPostgresUrl(state)) {
    store = OpenState(state, {.holder = "audit", .wait = [](const std::string&, double) { return true; }}).value();
  } else {
    store = SqliteStore::Open(state).value();
  }
  const Status read = store->Replay([&](const StoredRecord& stored) {
    v1::Record record;
    if (!stored.content.ok() || !record.ParseFromString(*stored.content)) record.Clear();
    audit.Add(record);
  });
  if (!read.ok()) throw std::runtime_error(state + ": " + read.ToString());
  return audit;
}

}  // namespace tessera::e2e
