// Queries of jobs, tasks and attempts.
#include <algorithm>
#include <iterator>
#include <tuple>

#include "common/base/version.h"
#include "server/jobs/jobs.h"
#include "server/jobs/planner.h"

namespace tessera {
namespace {

constexpr int kMaxJobsSeen = 1000;
constexpr int kMaxTasksSeen = 10'000;  // tasks or files visited per hold of the mutex

bool IsAmong(const std::vector<NamedDigest>& files, const Digest& digest) {
  return std::any_of(files.begin(), files.end(), [&](const NamedDigest& file) { return file.digest == digest; });
}

// Whether the blob is the survey of the job. Stops at the first cut: surveys come earlier, and millions of tasks later.
bool MadeSurvey(const Job& job, const Digest& digest) {
  for (const JobTask& task : job.tasks) {
    const TaskPhase phase = KindOf(task.plan.kind.str()).phase;
    if (phase == TaskPhase::kCut) return false;
    if (phase != TaskPhase::kSurvey) continue;
    for (const StoredFile& output : task.outputs) {
      if (output.name == kSurveyFile && output.digest() == digest) return true;
    }
  }
  return false;
}

// Of the present and of earlier plans, from index `first`, ascending.
std::vector<int> TasksOfTile(const Job& job, int tile, int first) {
  std::vector<int> tasks;
  const auto found = job.totals.tiles().find(tile);
  if (found == job.totals.tiles().end()) return tasks;
  const auto& [now, before] = std::tie(found->second.tasks, found->second.superseded);
  std::merge(std::lower_bound(now.begin(), now.end(), first), now.end(),
             std::lower_bound(before.begin(), before.end(), first), before.end(), std::back_inserter(tasks));
  return tasks;
}

}  // namespace

JobStatus Jobs::StoredStatusLocked(int job, size_t max_artifacts) const {
  JobStatus status = JobStatusLocked(job, max_artifacts);
  if (!core_.EndIsStored(job)) TakeEndFrom(status);
  return status;
}

StatusOr<JobStatus> Jobs::GetJob(const std::string& name) const {
  JobStatus status;
  {
    std::lock_guard lock(mutex_);
    TESSERA_ASSIGN_OR_RETURN(const int job, ledger_.FindJob(name));
    status = JobStatusLocked(job);
  }
  if (HasEnded(status.header.state)) TESSERA_RETURN_IF_ERROR(core_.Durable());  // an end is shown only when durable
  return status;
}

std::vector<JobStatus> Jobs::ListJobs(int before, int count) const {
  std::lock_guard lock(mutex_);
  std::vector<JobStatus> jobs;
  const int size = static_cast<int>(ledger_.jobs().size());
  int index = before < 0 || before > size ? size : before;
  while (--index >= 0 && static_cast<int>(jobs.size()) < count) {
    if (ledger_.jobs()[index].deleted) continue;
    jobs.push_back(StoredStatusLocked(index, 0));
  }
  return jobs;
}

StatusOr<WatchedJob> Jobs::WatchJob(const std::string& name, size_t max_running) const {
  std::lock_guard lock(mutex_);
  TESSERA_ASSIGN_OR_RETURN(const int job, ledger_.FindJob(name));
  WatchedJob watched{StoredStatusLocked(job), {}};
  watched.end_waits = HasEnded(ledger_.jobs()[job].header.state) && !HasEnded(watched.job.header.state);
  watched.running.reserve(max_running);
  for (const TaskRef ref : leases_.OfJob(job)) {
    if (watched.running.size() == max_running) break;
    watched.running.push_back(StatusOfTask(ledger_.jobs()[job], ref, leases_));
  }
  return watched;
}

StatusOr<std::vector<TaskStatus>> Jobs::ListTasks(const std::string& name, int first, int count) const {
  std::lock_guard lock(mutex_);
  TESSERA_ASSIGN_OR_RETURN(const int job, ledger_.FindJob(name));
  std::vector<TaskStatus> tasks;
  const int size = static_cast<int>(ledger_.jobs()[job].tasks.size());
  for (int i = std::max(0, first); i < size && static_cast<int>(tasks.size()) < count; ++i) {
    tasks.push_back(StatusOfTask(ledger_.jobs()[job], {job, i}, leases_));
  }
  return tasks;
}

StatusOr<std::vector<TaskStatus>> Jobs::RunningTasks(const std::string& name) const {
  std::lock_guard lock(mutex_);
  TESSERA_ASSIGN_OR_RETURN(const int job, ledger_.FindJob(name));
  std::vector<TaskStatus> tasks;
  for (const TaskRef ref : leases_.OfJob(job)) {
    tasks.push_back(StatusOfTask(ledger_.jobs()[job], ref, leases_));
  }
  return tasks;
}

StatusOr<AttemptPage> Jobs::ListAttempts(const std::string& name, int first, int number, int count,
                                         std::optional<int> tile) const {
  std::lock_guard lock(mutex_);
  TESSERA_ASSIGN_OR_RETURN(const int index, ledger_.FindJob(name));
  const Job& job = ledger_.jobs()[index];
  first = std::max(0, first);
  AttemptPage page;
  int next = std::max(1, number);
  // Adds the task's attempts from `next`; false if the page is full.
  const auto add = [&](int task) {
    for (; next <= job.tasks[task].attempt(); ++next) {
      if (static_cast<int>(page.attempts.size()) == count) {
        page.next_task = task;
        page.next_number = next;
        return false;
      }
      const PlannedTask& plan = job.tasks[task].plan;
      page.attempts.push_back(
          {{index, task}, next, plan.kind, plan.name, plan.tile, job.tasks[task].attempts[next - 1]});
    }
    next = 1;
    return true;
  };
  if (tile) {
    for (const int task : TasksOfTile(job, *tile, first)) {
      if (task > first) next = 1;  // `number` is of task `first`
      if (!add(task)) return page;
    }
    return page;
  }
  const int end = static_cast<int>(job.tasks.size());
  const auto limit = static_cast<int>(std::min<int64_t>(end, int64_t{first} + kMaxTasksSeen));
  int task = first;
  for (; task < limit; ++task) {
    if (!add(task)) return page;
  }
  if (task < end) page.next_task = task;
  return page;
}

StatusOr<ArtifactPage> Jobs::ListArtifacts(const std::string& name, const std::string& prefix, int first,
                                           int count) const {
  ArtifactPage page;
  bool ended = false;
  {
    std::lock_guard lock(mutex_);
    TESSERA_ASSIGN_OR_RETURN(const int job, ledger_.FindJob(name));
    ended = HasEnded(ledger_.jobs()[job].header.state);
    const std::vector<NamedDigest>& all = ledger_.jobs()[job].artifacts;
    const int end = static_cast<int>(all.size());
    int i = std::max(0, first);
    const auto limit = static_cast<int>(std::min<int64_t>(end, int64_t{i} + kMaxTasksSeen));
    for (; i < limit && static_cast<int>(page.artifacts.size()) < count; ++i) {
      if (all[i].name.starts_with(prefix)) page.artifacts.push_back(all[i]);
    }
    if (i < end) page.next = i;
  }
  if (ended) TESSERA_RETURN_IF_ERROR(core_.Durable());  // an end is shown only when durable
  return page;
}

std::optional<KnownSurvey> Jobs::FindSurvey(const NewJob& job) const {
  std::vector<NamedDigest> files = job.scene_files;
  std::sort(files.begin(), files.end(), [](const NamedDigest& a, const NamedDigest& b) { return a.name < b.name; });
  std::vector<std::string> names;
  for (const NamedDigest& file : files) names.push_back(file.name);
  const auto planned = environment_.planner->Ingest(job.settings, names, {});
  if (!planned.ok()) return std::nullopt;
  const std::string& parameters = planned->back().parameters;  // of the task that makes the survey
  std::lock_guard lock(mutex_);
  const std::vector<Job>& jobs = ledger_.jobs();
  const int last = static_cast<int>(jobs.size()) - 1;
  for (int i = last; i >= 0 && i > last - kMaxJobsSeen; --i) {
    if (jobs[i].deleted || jobs[i].header.algorithm_version != kAlgorithmVersion || jobs[i].scene_files != files)
      continue;
    const size_t at = planned->size() - 1;
    if (jobs[i].tasks.size() <= at) continue;
    const JobTask& task = jobs[i].tasks[at];
    if (task.state != TaskState::kSucceeded || task.plan.kind != kIngestKind || task.plan.parameters != parameters) {
      continue;
    }
    for (const StoredFile& output : task.outputs) {
      if (output.name == kSurveyFile) return KnownSurvey{jobs[i].header.name, output.digest()};
    }
  }
  return std::nullopt;
}

bool Jobs::IsPublished(const Digest& digest) const {
  std::lock_guard lock(mutex_);
  return std::any_of(ledger_.jobs().rbegin(), ledger_.jobs().rend(),
                     [&](const Job& job) { return IsAmong(job.artifacts, digest) || MadeSurvey(job, digest); });
}

std::vector<std::string> Jobs::SceneFilesWith(const Digest& digest) const {
  std::lock_guard lock(mutex_);
  return ledger_.scene_files().PathsOf(digest);
}

}  // namespace tessera
