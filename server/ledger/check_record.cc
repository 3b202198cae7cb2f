#include "server/ledger/check_record.h"

#include <algorithm>
#include <iterator>
#include <set>

#include "common/job/task_parameters.h"
#include "server/ledger/digest_proto.h"
#include "server/ledger/ledger.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

constexpr int64_t kLastTimeUs = 253'402'300'799'999'999;  // end of the year 9999: differences of times cannot overflow
// Most consecutive jobs whose acceptance records may be lost. Their numbers are not reused.
constexpr int kMaxLostJobs = 1000;

// Whether the task may run: its job is active, or its lost result is being recomputed.
bool MayRun(const Ledger& ledger, TaskRef ref) {
  return !HasEnded(ledger.jobs()[ref.job].header.state) || ledger.task(ref).remaking;
}

// Whether a new job may have this index. A gap of more than kMaxLostJobs lost records is an error.
bool MayBeNext(const Ledger& ledger, int job) {
  const int next = static_cast<int>(ledger.jobs().size());
  if (job < next) return false;
  const auto deleted =
      std::distance(ledger.expected_deleted().lower_bound(next), ledger.expected_deleted().upper_bound(job));
  return job - next <= kMaxLostJobs + deleted;
}

// The task, if it may run and `attempt` is its leased attempt; else NOT_FOUND or FAILED_PRECONDITION.
StatusOr<TaskRef> CheckCurrentAttempt(const Ledger& ledger, const std::string& name, int attempt) {
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, ledger.FindTask(name));
  const JobTask& target = ledger.task(ref);
  if (!MayRun(ledger, ref)) {
    return absl::FailedPreconditionError(name + ": its job has ended");
  }
  if (target.state != TaskState::kLeased || target.attempt() != attempt) {
    return absl::FailedPreconditionError(name + ": attempt " + std::to_string(attempt) + " is not the current one (" +
                                         std::to_string(target.attempt()) +
                                         (target.state == TaskState::kLeased ? ")" : ", not leased)"));
  }
  return ref;
}

Status CheckAccepted(const Ledger& ledger, const v1::JobAccepted& change) {
  TESSERA_ASSIGN_OR_RETURN(const int index, ParseJobName(change.job()));
  if (!MayBeNext(ledger, index)) {
    const int next = static_cast<int>(ledger.jobs().size());
    return absl::FailedPreconditionError("the next job is " + JobName(next) + ", not " + change.job());
  }
  if (ledger.job_of_request().contains(change.request_id())) {
    return absl::AlreadyExistsError("request " + change.request_id() + " already has a job");
  }
  TESSERA_RETURN_IF_ERROR(CheckPriority(change.priority()));
  std::set<std::string> names;
  for (const auto& file : change.scene_files()) {
    TESSERA_RETURN_IF_ERROR(CheckDigest(FromProto(file.digest())));
    if (!names.insert(file.path()).second) return absl::InvalidArgumentError("duplicate scene file: " + file.path());
  }
  return absl::OkStatus();
}

Status CheckPlanned(const Ledger& ledger, const v1::TasksPlanned& change) {
  TESSERA_ASSIGN_OR_RETURN(const int index, ledger.FindJob(change.job()));
  const Job& job = ledger.jobs()[index];
  if (HasEnded(job.header.state)) return absl::FailedPreconditionError(change.job() + " has ended");
  if (change.tasks().empty() && job.replan_from < 0) return absl::InvalidArgumentError("the plan has no tasks");
  int count = static_cast<int>(job.tasks.size());
  if (change.first_task() != count && (job.open_plan < 0 || change.first_task() != job.open_plan)) {
    return absl::FailedPreconditionError(
        "plan of " + change.job() + " from task " + std::to_string(change.first_task()) + ", expected from task " +
        std::to_string(count) + (job.open_plan < 0 ? "" : " or " + std::to_string(job.open_plan)));
  }
  count = change.first_task();
  std::set<int> superseded;
  for (const int task : change.superseded()) {
    if (task < 0 || task >= count || job.tasks[task].superseded || !superseded.insert(task).second) {
      return absl::InvalidArgumentError("plan of " + change.job() + ": supersedes task " + std::to_string(task) +
                                        ", which is missing, listed twice or superseded already");
    }
  }
  for (const auto& planned : change.tasks()) {
    const auto fault = [&](const std::string& what) {
      return absl::InvalidArgumentError("plan of " + change.job() + ", '" + planned.title() + "': " + what);
    };
    std::set<std::string> names;
    if (planned.kind().empty()) return fault("no kind");
    if (!(planned.cost() >= 0)) return fault("cost is not a number of at least 0");
    for (const auto& output : planned.given()) TESSERA_RETURN_IF_ERROR(CheckDigest(FromProto(output.digest())));
    if (!planned.given().empty() &&
        planned.inputs_size() + planned.scene_files_size() + planned.view_files_size() > 0) {
      return fault("has inputs, though its outputs are given");
    }
    for (const auto& input : planned.inputs()) {
      const std::string name = InputName({TaskId(input.task()), input.output(), input.has_tile() ? input.tile() : -1});
      if (!names.insert(name).second) return fault("two inputs named " + name);
      if (input.task() < 0 || input.task() >= count) {
        return fault("input " + name + " comes from task " + std::to_string(input.task()) + ", which is not before it");
      }
    }
    for (int i = 0, last = -1; i < planned.scene_files_size(); last = planned.scene_files(i++)) {
      if (planned.scene_files(i) <= last || planned.scene_files(i) >= static_cast<int>(job.scene_files.size())) {
        return fault("scene file " + std::to_string(planned.scene_files(i)) + " of " +
                     std::to_string(job.scene_files.size()) + ", after " + std::to_string(last));
      }
    }
    for (const auto& file : planned.view_files()) {
      if (file.file() >= 0 && file.file() < static_cast<int>(job.scene_files.size()) && file.view() >= 0 &&
          names.insert(ViewInputName({file.file(), file.view(), file.likelihoods(), file.mask()})).second) {
        continue;
      }
      return fault("file " + std::to_string(file.file()) + " of view " + std::to_string(file.view()) + ", of " +
                   std::to_string(job.scene_files.size()) + " scene files");
    }
    ++count;
  }
  return absl::OkStatus();
}

Status CheckStarted(const Ledger& ledger, const v1::AttemptStarted& change) {
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, ledger.FindTask(change.task()));
  const JobTask& target = ledger.task(ref);
  if (!MayRun(ledger, ref) || target.state != TaskState::kReady) {
    return absl::FailedPreconditionError(change.task() + " is not ready");
  }
  if (change.attempt() != target.attempt() + 1) {
    return absl::FailedPreconditionError(change.task() + ": the next attempt is " +
                                         std::to_string(target.attempt() + 1));
  }
  return absl::OkStatus();
}

Status CheckSucceeded(const Ledger& ledger, const v1::TaskSucceeded& change) {
  std::set<std::string> names;
  for (const auto& output : change.outputs()) {
    TESSERA_RETURN_IF_ERROR(CheckDigest(FromProto(output.digest())));
    if (!names.insert(output.name()).second) return absl::InvalidArgumentError("duplicate output: " + output.name());
  }
  if (!Sha256::FromHex(change.key())) return absl::InvalidArgumentError("malformed key: '" + change.key() + "'");
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, ledger.FindTask(change.task()));
  TESSERA_RETURN_IF_ERROR(CheckSameAsBefore(ledger.task(ref), NamedDigests(change.outputs())));
  if (!change.reused()) return CheckCurrentAttempt(ledger, change.task(), change.attempt()).status();
  if (!MayRun(ledger, ref) || ledger.task(ref).state != TaskState::kReady) {
    return absl::FailedPreconditionError(change.task() + " is not ready");
  }
  return absl::OkStatus();
}

Status CheckFailed(const Ledger& ledger, const v1::AttemptFailed& change) {
  return CheckCurrentAttempt(ledger, change.task(), change.attempt()).status();
}

Status CheckEnded(const Ledger& ledger, const v1::JobEnded& change) {
  TESSERA_ASSIGN_OR_RETURN(const int index, ledger.FindJob(change.job()));
  const Job& job = ledger.jobs()[index];
  if (HasEnded(job.header.state)) return absl::FailedPreconditionError(change.job() + " has ended");
  if (!HasEnded(static_cast<JobState>(change.state()))) return absl::InvalidArgumentError("not a final state of a job");
  if (change.state() == v1::JOB_STATE_SUCCEEDED || change.state() == v1::JOB_STATE_PARTIAL) {
    if (job.quarantined.empty() != (change.state() == v1::JOB_STATE_SUCCEEDED)) {
      return absl::FailedPreconditionError(change.job() + ": " + std::to_string(job.quarantined.size()) +
                                           " tiles are quarantined");
    }
    for (const JobTask& each : job.tasks) {
      if (!each.superseded && each.state != TaskState::kSucceeded) {
        return absl::FailedPreconditionError(change.job() + ": '" + each.plan.name + "' has not succeeded");
      }
    }
  }
  return absl::OkStatus();
}

Status CheckChanged(const Ledger& ledger, const v1::JobChanged& change) {
  TESSERA_ASSIGN_OR_RETURN(const int index, ledger.FindJob(change.job()));
  if (HasEnded(ledger.jobs()[index].header.state)) return absl::FailedPreconditionError(change.job() + " has ended");
  return CheckPriority(change.priority());
}

Status CheckQuarantined(const Ledger& ledger, const v1::TileQuarantined& change) {
  TESSERA_ASSIGN_OR_RETURN(const int index, ledger.FindJob(change.job()));
  const Job& job = ledger.jobs()[index];
  if (HasEnded(job.header.state)) return absl::FailedPreconditionError(change.job() + " has ended");
  if (change.task() < 0 || change.task() >= static_cast<int>(job.tasks.size())) {
    return absl::NotFoundError(change.job() + " has no task " + std::to_string(change.task()));
  }
  const JobTask& task = job.tasks[change.task()];
  if (task.state != TaskState::kFailed || task.superseded || change.tile() < 0 || task.plan.tile != change.tile()) {
    return absl::FailedPreconditionError(change.job() + ": '" + task.plan.name + "' has not failed for tile " +
                                         std::to_string(change.tile()));
  }
  return absl::OkStatus();
}

Status CheckRetried(const Ledger& ledger, const v1::JobRetried& change) {
  TESSERA_ASSIGN_OR_RETURN(const int index, ledger.FindJob(change.job()));
  const Job& job = ledger.jobs()[index];
  if (job.header.state != JobState::kFailed && job.header.state != JobState::kPartial) {
    return absl::FailedPreconditionError(change.job() + " has not failed: nothing to retry");
  }
  if (!change.has_tile()) return absl::OkStatus();
  bool found = std::any_of(job.quarantined.begin(), job.quarantined.end(),
                           [&](const QuarantinedTile& each) { return each.tile == change.tile(); });
  for (const JobTask& task : job.tasks) {
    if (task.state != TaskState::kFailed || task.superseded) continue;
    if (task.plan.tile != change.tile()) {
      return absl::FailedPreconditionError(change.job() + ": '" + task.plan.name +
                                           "' has failed too and is not of tile " + std::to_string(change.tile()) +
                                           "; retry the whole job");
    }
    found = true;
  }
  if (found) return absl::OkStatus();
  return absl::FailedPreconditionError(change.job() + ": no task of tile " + std::to_string(change.tile()) +
                                       " has failed");
}

Status CheckLost(const Ledger& ledger, const v1::ResultLost& change) {
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, ledger.FindTask(change.task()));
  const JobTask& target = ledger.task(ref);
  const JobHeader& header = ledger.jobs()[ref.job].header;
  if (!target.plan.given->empty())
    return absl::FailedPreconditionError(change.task() + " did not run in this job: its outputs come from a base job");
  if (target.state != TaskState::kSucceeded && !target.remaking) {
    return absl::FailedPreconditionError(change.task() + " has no result");
  }
  if (HasEnded(header.state) && header.state != JobState::kSucceeded && header.state != JobState::kPartial) {
    return absl::FailedPreconditionError(change.task() + ": its job has ended without a result");
  }
  for (const std::string& name : change.needed_by_tasks()) {
    TESSERA_ASSIGN_OR_RETURN(const TaskRef reader, ledger.FindTask(name));
    const JobTask& given = ledger.task(reader);
    if (given.plan.given->empty()) return absl::FailedPreconditionError(name + " has no outputs of a base job");
    if (given.state == TaskState::kFailed) return absl::FailedPreconditionError(name + " has failed");
    if (HasEnded(ledger.jobs()[reader.job].header.state)) {
      return absl::FailedPreconditionError(name + ": its job has ended");
    }
  }
  for (const std::string& name : change.needed_by_jobs()) {
    TESSERA_ASSIGN_OR_RETURN(const int job, ledger.FindJob(name));
    if (HasEnded(ledger.jobs()[job].header.state)) return absl::FailedPreconditionError(name + " has ended");
  }
  return absl::OkStatus();
}

Status CheckDeleted(const Ledger& ledger, const v1::JobDeleted& change) {
  TESSERA_ASSIGN_OR_RETURN(const int named, ParseJobName(change.job()));
  const bool known = named < static_cast<int>(ledger.jobs().size());
  if (ledger.expected_deleted().contains(named) && (known ? ledger.jobs()[named].deleted : MayBeNext(ledger, named))) {
    return absl::OkStatus();
  }
  TESSERA_ASSIGN_OR_RETURN(const int index, ledger.FindJob(change.job()));
  return CheckMayDelete(ledger, index);
}

Status CheckRestarted(const Ledger& ledger, const v1::JobRestarted& change) {
  TESSERA_ASSIGN_OR_RETURN(const int index, ledger.FindJob(change.job()));
  if (HasEnded(ledger.jobs()[index].header.state)) return absl::FailedPreconditionError(change.job() + " has ended");
  return absl::OkStatus();
}

}  // namespace

Status CheckRecord(const Ledger& ledger, const v1::Record& record) {
  if (record.time_us() < 0 || record.time_us() > kLastTimeUs) {
    return absl::InvalidArgumentError("time of the record out of range: " + std::to_string(record.time_us()) + " us");
  }
  switch (record.change_case()) {
    case v1::Record::kJobAccepted:
      return CheckAccepted(ledger, record.job_accepted());
    case v1::Record::kTasksPlanned:
      return CheckPlanned(ledger, record.tasks_planned());
    case v1::Record::kAttemptStarted:
      return CheckStarted(ledger, record.attempt_started());
    case v1::Record::kTaskSucceeded:
      return CheckSucceeded(ledger, record.task_succeeded());
    case v1::Record::kAttemptFailed:
      return CheckFailed(ledger, record.attempt_failed());
    case v1::Record::kJobEnded:
      return CheckEnded(ledger, record.job_ended());
    case v1::Record::kJobChanged:
      return CheckChanged(ledger, record.job_changed());
    case v1::Record::kTileQuarantined:
      return CheckQuarantined(ledger, record.tile_quarantined());
    case v1::Record::kJobRetried:
      return CheckRetried(ledger, record.job_retried());
    case v1::Record::kResultLost:
      return CheckLost(ledger, record.result_lost());
    case v1::Record::kJobDeleted:
      return CheckDeleted(ledger, record.job_deleted());
    case v1::Record::kJobRestarted:
      return CheckRestarted(ledger, record.job_restarted());
    case v1::Record::CHANGE_NOT_SET:
      break;
  }
  return absl::InvalidArgumentError("unknown kind of record");
}

Status CheckSameAsBefore(const JobTask& target, const std::vector<NamedDigest>& outputs) {
  if (!target.remaking) return absl::OkStatus();
  for (const StoredFile& before : target.outputs) {
    const auto now = std::find_if(outputs.begin(), outputs.end(),
                                  [&](const NamedDigest& output) { return output.name == before.name; });
    if (now != outputs.end() && now->digest == before.digest()) continue;
    return absl::FailedPreconditionError(
        "'" + target.plan.name + "' was recomputed with another result, expected the same bytes as before: output " +
        before.name.str() + ": found " + (now == outputs.end() ? "no such output" : now->digest.sha256) +
        ", expected " + before.sha256.Hex());
  }
  return absl::OkStatus();
}

Status CheckMayDelete(const Ledger& ledger, int index) {
  const JobHeader& header = ledger.jobs()[index].header;
  if (!HasEnded(header.state)) {
    return absl::FailedPreconditionError(header.name + " has not ended: cancel it first");
  }
  std::string readers;
  for (const Job& other : ledger.jobs()) {
    const UpdateSettings& update = other.header.settings.update;
    if (other.deleted || (update.base != header.name && update.rollback_to != header.name)) continue;
    readers += (readers.empty() ? "" : ", ") + other.header.name;
  }
  if (readers.empty()) return absl::OkStatus();
  return absl::FailedPreconditionError(header.name + " is the base of other jobs: delete " + readers + " first");
}

}  // namespace tessera
