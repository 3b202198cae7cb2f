#include "server/ledger/job.h"

#include <algorithm>
#include <cmath>

#include "common/job/task_parameters.h"

namespace tessera {
namespace {

// The number in `text`, 1 to 9 digits without leading zero; else -1.
int ParseNumber(const std::string& text) {
  if (text.empty() || text.size() > 9 || (text[0] == '0' && text.size() > 1)) return -1;
  int number = 0;
  for (const char c : text) {
    if (c < '0' || c > '9') return -1;
    number = number * 10 + (c - '0');
  }
  return number;
}

constexpr char kJobs[] = "jobs/";
constexpr char kTasks[] = "/tasks/";

PhaseWork& PhaseOf(const JobTask& task, WorkByPhase& work) {
  return work[{task.depth, MemoryStep(task.plan.peak_bytes)}];
}

std::pair<int, int> StageKey(const JobTask& task) { return {task.depth, KindIndex(task.plan.kind.str())}; }

void AddUnfinished(const JobTask& task, int count, WorkByPhase& work) {
  PhaseWork& phase = PhaseOf(task, work);
  phase.unfinished += count;
  phase.unfinished_core_s += count * task.plan.cost;
}

}  // namespace

JobSums::Part& JobSums::PartOf(const std::string& kind) {
  switch (KindOf(kind).phase) {
    case TaskPhase::kSurvey:
      return ingest;
    case TaskPhase::kCut:
      return cut;
    case TaskPhase::kRest:
      return rest;
  }
  return rest;
}

void JobSums::AddRun(const PlannedTask& plan, double cost, double seconds) {
  if (&PartOf(plan.kind) == &ingest) return;  // its speed predicts nothing about tiles
  timed_cost += cost;
  timed_s += seconds;
}

int MemoryStep(int64_t peak_bytes) {
  if (peak_bytes <= 0) return kUnknownMemoryStep;
  return static_cast<int>(std::ceil(16 * std::log2(static_cast<double>(peak_bytes) / (1 << 30))));
}

size_t TileTotals::FirstOpen(const std::deque<JobTask>& all) const {
  while (open_from < tasks.size() && all[tasks[open_from]].state == TaskState::kSucceeded) ++open_from;
  return open_from;
}

void JobTotals::AddPlanned(int index, const JobTask& task) {
  if (!task.plan.given->empty()) return;
  PhaseWork& phase = PhaseOf(task, work_);
  ++phase.planned;
  phase.planned_core_s += task.plan.cost;
  phase.most_core_s = std::max(phase.most_core_s, task.plan.cost);
  AddUnfinished(task, 1, work_);
  ++sums_.tasks;
  sums_.bytes_to_store += task.plan.stored_bytes;
  sums_.PartOf(task.plan.kind).total += task.plan.cost;
  sums_.later += task.plan.later_cost;
  sums_.later_bytes += task.plan.later_bytes;
  ++stages_[StageKey(task)].planned;
  if (task.plan.tile < 0) return;
  const auto [of_tile, is_new] = tiles_.try_emplace(task.plan.tile);
  TileTotals& tile = of_tile->second;
  sums_.tiles += is_new;
  sums_.unfinished_tiles += tile.unfinished++ == 0;
  tile.tasks.push_back(index);
  tile.predicted_core_seconds += task.plan.cost;
  tile.predicted_peak_bytes = std::max(tile.predicted_peak_bytes, task.plan.peak_bytes);
}

void JobTotals::AddQuarantined(int tile) {
  const auto [of_tile, is_new] = tiles_.try_emplace(tile);
  sums_.tiles += is_new;
  sums_.unfinished_tiles += of_tile->second.unfinished++ == 0;
}

void JobTotals::AddSucceeded(int index, const JobTask& task) {
  ++sums_.tasks_done;
  AddUnfinished(task, -1, work_);
  sums_.bytes_to_store -= task.plan.stored_bytes;
  sums_.PartOf(task.plan.kind).done += task.plan.cost;
  const double used_s = task.reused ? 0 : task.usage.core_seconds;
  sums_.core_seconds += used_s;
  ++stages_[StageKey(task)].done;
  if (!task.reused) {
    sums_.AddRun(task.plan, task.plan.cost, static_cast<double>(task.end_us - task.attempts.back().start_us) / 1e6);
  }
  if (!task.warnings->empty()) warned_.insert(index);
  if (task.plan.tile < 0) return;
  TileTotals& tile = tiles_[task.plan.tile];
  sums_.unfinished_tiles -= --tile.unfinished == 0;
  tile.reused += task.reused;
  tile.core_seconds += used_s;
  tile.done_core_seconds += task.plan.cost;
  if (!task.reused) tile.peak_bytes = std::max(tile.peak_bytes, task.usage.peak_bytes);
}

void JobTotals::AddLost(int index, const JobTask& task) {
  --sums_.tasks_done;
  AddUnfinished(task, 1, work_);
  sums_.bytes_to_store += task.plan.stored_bytes;
  sums_.PartOf(task.plan.kind).done -= task.plan.cost;
  --stages_[StageKey(task)].done;
  warned_.erase(index);
  if (task.plan.tile < 0) return;
  TileTotals& tile = tiles_[task.plan.tile];
  sums_.unfinished_tiles += tile.unfinished++ == 0;
  tile.reused -= task.reused;
  tile.done_core_seconds -= task.plan.cost;
  const auto at = std::lower_bound(tile.tasks.begin(), tile.tasks.end(), index) - tile.tasks.begin();
  tile.open_from = std::min(tile.open_from, static_cast<size_t>(at));
}

void JobTotals::AddAttempt(int tile, int attempts, int failed) {
  const auto of_tile = tiles_.find(tile);
  if (of_tile == tiles_.end()) return;
  of_tile->second.attempts += attempts;
  of_tile->second.failed_attempts += failed;
}

void JobTotals::AddSuperseded(int index, int tile) {
  const auto of_tile = tiles_.find(tile);
  if (of_tile != tiles_.end()) of_tile->second.superseded.push_back(index);
}

StageCount JobTotals::StageOf(const JobTask& task) const {
  const auto found = stages_.find(StageKey(task));
  return found == stages_.end() ? StageCount() : found->second;
}

// Job names count from 1. Task names are indices from 0, as in the inputs of a plan.
std::string JobName(int job) { return kJobs + std::to_string(job + 1); }

std::string TaskName(TaskRef ref) { return JobName(ref.job) + kTasks + std::to_string(ref.task); }

StatusOr<int> ParseJobName(const std::string& name) {
  const std::string prefix = kJobs;
  const int number = name.compare(0, prefix.size(), prefix) == 0 ? ParseNumber(name.substr(prefix.size())) : -1;
  if (number < 1) return absl::InvalidArgumentError("not a job's name (jobs/J): '" + name + "'");
  return number - 1;
}

StatusOr<TaskRef> ParseTaskName(const std::string& name) {
  const size_t split = name.find(kTasks);
  if (split != std::string::npos) {
    const auto job = ParseJobName(name.substr(0, split));
    const int task = ParseNumber(name.substr(split + std::string(kTasks).size()));
    if (job.ok() && task >= 0) return TaskRef{*job, task};
  }
  return absl::InvalidArgumentError("not a task's name (jobs/J/tasks/T): '" + name + "'");
}

JobTask WithCountedAttempts(JobTask task) {
  task.attempts.erase(task.attempts.begin(), task.attempts.begin() + task.forgiven);
  return task;
}

int64_t BytesToStore(const Job& job) {
  const JobSums& sums = job.totals.sums();
  return sums.bytes_to_store + (job.planned_to_end ? 0 : sums.later_bytes);
}

bool CutsAreDone(const Job& job) {
  const auto end = job.replan_from < 0 ? job.tasks.end() : job.tasks.begin() + job.replan_from;
  return std::all_of(job.tasks.begin(), end, [](const JobTask& task) {
    return task.plan.kind != kCutKind || task.superseded || task.state == TaskState::kSucceeded;
  });
}

const JobTask* SplitBefore(const Job& job, const PlannedTask& task) {
  for (const PlannedInput& input : task.inputs) {
    const JobTask& producer = job.tasks[input.task.value()];
    if (input.output == kTileFile) return SplitBefore(job, producer.plan);
    if (input.output == kCityFile) return producer.plan.kind == kSplitKind ? &producer : nullptr;
  }
  return nullptr;
}

FailedTile FailedTileOf(const Job& job, const QuarantinedTile& tile) {
  const PlannedTask& failed = job.tasks[tile.task].plan;
  FailedTile out = {tile.tile, failed.kind};
  if (const auto parameters = ParseStepParameters(failed.parameters); parameters.ok()) {
    out.step = parameters->step;
    out.before = parameters->before;
  }
  out.fine = IsOfFinePart(job, failed);
  return out;
}

int FirstBehindCuts(const Job& job, bool fine) {
  int first = 0;
  for (int i = 0; i < static_cast<int>(job.tasks.size()); ++i) {
    const PlannedTask& task = job.tasks[i].plan;
    if (task.kind != kCutKind) continue;
    const JobTask* const split = SplitBefore(job, task);
    if (fine ? split != nullptr && !split->superseded : split == nullptr) first = i + 1;
  }
  return first;
}

Status CheckPriority(int priority) {
  if (priority >= -kMaxPriority && priority <= kMaxPriority) return absl::OkStatus();
  return InputError("priority", "", std::to_string(priority),
                    std::to_string(-kMaxPriority) + " to " + std::to_string(kMaxPriority));
}

std::string ErrorClassName(ErrorClass error_class) {
  switch (error_class) {
    case ErrorClass::kNone:
      return "none";
    case ErrorClass::kInput:
      return "input";
    case ErrorClass::kTransient:
      return "transient";
    case ErrorClass::kMemory:
      return "memory";
    case ErrorClass::kPoison:
      return "poison";
    case ErrorClass::kPreempted:
      return "preempted";
    case ErrorClass::kLostInput:
      return "lost input";
    case ErrorClass::kScratch:
      return "scratch";
    case ErrorClass::kStorage:
      return "storage";
    case ErrorClass::kPeer:
      return "peer";
    case ErrorClass::kInternal:
      return "internal";
  }
  return "unknown";
}

}  // namespace tessera
