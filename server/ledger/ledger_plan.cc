// Adds the tasks of a plan to a job. A long plan is stored as several records; the last one makes its tasks ready.
#include <algorithm>
#include <set>
#include <utility>

#include "common/job/task_parameters.h"
#include "server/ledger/digest_proto.h"
#include "server/ledger/ledger.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

// Limits of predictions, so that sums over millions of tasks do not overflow.
constexpr int64_t kMaxPeakBytes = int64_t{1} << 46, kMaxStoredBytes = int64_t{1} << 40;
constexpr double kMaxCost = 1e12;

PlannedTask FromProto(const v1::PlannedTaskRecord& record) {
  PlannedTask task;
  task.kind = record.kind();
  task.name = record.title();
  task.tile = record.tile();
  task.parameters = record.parameters_json();
  task.cost = std::min(record.cost(), kMaxCost);
  task.scale = record.scale();
  task.peak_bytes = std::clamp(record.peak_bytes(), int64_t{0}, kMaxPeakBytes);
  task.stored_bytes = std::clamp(record.stored_bytes(), int64_t{0}, kMaxStoredBytes);
  task.scene_files = std::vector<int>(record.scene_files().begin(), record.scene_files().end());
  for (const auto& file : record.view_files()) {
    task.view_files.Edit().push_back({file.file(), file.view(), file.likelihoods()});
  }
  for (const auto& input : record.inputs()) {
    task.inputs.push_back({TaskId(input.task()), input.output(), input.has_tile() ? input.tile() : -1});
  }
  task.given = NamedDigests(record.given());
  return task;
}

}  // namespace

Status Ledger::CheckPlanned(const v1::TasksPlanned& change) const {
  TESSERA_ASSIGN_OR_RETURN(const int index, FindJob(change.job()));
  const Job& job = jobs_[index];
  if (HasEnded(job.header.state)) return absl::FailedPreconditionError(change.job() + " has ended");
  if (change.tasks().empty()) return absl::InvalidArgumentError("the plan has no tasks");
  int count = static_cast<int>(job.tasks.size());
  if (change.first_task() != count && (job.open_plan < 0 || change.first_task() != job.open_plan)) {
    return absl::FailedPreconditionError("plan of " + change.job() + " from task " +
                                         std::to_string(change.first_task()) + ", the next is " +
                                         std::to_string(count));
  }
  count = change.first_task();
  std::set<int> superseded;
  for (const int task : change.superseded()) {
    if (task < 0 || task >= count || job.tasks[task].superseded || !superseded.insert(task).second) {
      return absl::InvalidArgumentError("plan of " + change.job() + ": supersedes task " + std::to_string(task));
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
          names.insert(ViewFileName(file.view(), file.likelihoods())).second) {
        continue;
      }
      return fault("file " + std::to_string(file.file()) + " of view " + std::to_string(file.view()) + ", of " +
                   std::to_string(job.scene_files.size()) + " scene files");
    }
    ++count;
  }
  return absl::OkStatus();
}

void Ledger::ApplyPlanned(const v1::TasksPlanned& change) {
  const int index = *FindJob(change.job());
  Job& job = jobs_[index];
  if (job.open_plan >= 0 && change.first_task() == job.open_plan) DropOpenPlan(job);
  if (job.open_plan < 0) job.open_plan = change.first_task();
  for (const auto& planned : change.tasks()) {
    JobTask added;
    added.plan = FromProto(planned);
    for (const PlannedInput& input : added.plan.inputs) {
      JobTask& producer = job.tasks[input.task.value()];
      producer.readers.push_back(static_cast<int>(job.tasks.size()));
      added.missing += producer.state != TaskState::kSucceeded;
      added.depth = std::max(added.depth, producer.depth + 1);
    }
    job.planned_to_end = job.planned_to_end || added.plan.kind == kPublishKind ||
                         (added.plan.kind == kPlanKind && job.header.settings.update.plan_only);
    if (!added.plan.given->empty()) {
      added.state = TaskState::kSucceeded;
      added.reused = true;
      added.outputs.assign(added.plan.given->begin(), added.plan.given->end());
    } else {
      ++job.unfinished;
    }
    if (added.plan.stored_bytes > 0) ready_.Hold(index);
    job.totals.AddPlanned(added);
    job.tasks.push_back(std::move(added));
  }
  if (!change.more()) {
    for (const int task : change.superseded()) Supersede({index, task});
    if (!change.superseded().empty()) Recount(job);
    job.plans_anew = false;
    const int first = std::exchange(job.open_plan, -1);
    for (int task = first; task < static_cast<int>(job.tasks.size()); ++task) ReadyTask({index, task});
  }
  UpdateDue(index);
}

void Ledger::DropOpenPlan(Job& job) {
  const auto first = static_cast<size_t>(job.open_plan);
  for (size_t task = first; task < job.tasks.size(); ++task) {
    for (const PlannedInput& input : job.tasks[task].plan.inputs) {
      auto& readers = job.tasks[input.task.value()].readers;
      while (!readers.empty() && readers.back() >= job.open_plan) readers.pop_back();
    }
  }
  for (size_t task = first; task < job.tasks.size(); ++task) job.unfinished -= job.tasks[task].plan.given->empty();
  job.tasks.resize(first);
  Recount(job);
  job.planned_to_end = job.plans_anew;
  job.open_plan = -1;
}

}  // namespace tessera
