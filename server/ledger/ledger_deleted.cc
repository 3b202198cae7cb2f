// Deletion and restart of jobs.
#include <algorithm>
#include <iterator>
#include <utility>

#include "server/ledger/ledger.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

// Most consecutive jobs whose acceptance records may be lost. Their numbers are not reused.
constexpr int kMaxLostJobs = 1000;

}  // namespace

bool Ledger::MayBeNext(int job) const {
  const int next = static_cast<int>(jobs_.size());
  if (job < next) return false;
  const auto deleted = std::distance(expected_deleted_.lower_bound(next), expected_deleted_.upper_bound(job));
  return job - next <= kMaxLostJobs + deleted;
}

bool Ledger::WasDeleted(int job) const {
  return job >= 0 && job < static_cast<int>(jobs_.size()) && jobs_[job].deleted;
}

Status Ledger::CheckVersion(int job, const std::string& then) const {
  const JobHeader& header = jobs_[job].header;
  if (header.algorithm_version == algorithm_version_) return absl::OkStatus();
  return absl::FailedPreconditionError(header.name + " was made by algorithm version " + header.algorithm_version +
                                       ", and this coordinator has " + algorithm_version_ + ": " + then);
}

bool Ledger::Runs(int job) const {
  if (!HasEnded(jobs_[job].header.state)) return true;
  const auto remake = remakes_of_ended_.lower_bound({job, -1});
  return remake != remakes_of_ended_.end() && remake->job == job;
}

void Ledger::DropRemakesOf(int job) {
  const auto first = remakes_of_ended_.lower_bound({job, -1});
  remakes_of_ended_.erase(first, remakes_of_ended_.lower_bound({job + 1, -1}));
}

void Ledger::DropReady(int job) {
  ready_.DropJob(job);
  std::erase_if(newly_ready_, [&](TaskRef ref) { return ref.job == job; });
}

void Ledger::EndReplay() {
  for (const int job : expected_deleted_) {
    if (MayBeNext(job)) FillJobsUpTo(job + 1);
  }
}

Status Ledger::MayDelete(int index) const {
  const JobHeader& header = jobs_[index].header;
  if (!HasEnded(header.state)) {
    return absl::FailedPreconditionError(header.name + " has not ended: cancel it first");
  }
  std::string readers;
  for (const Job& other : jobs_) {
    const UpdateSettings& update = other.header.settings.update;
    if (other.deleted || (update.base != header.name && update.rollback_to != header.name)) continue;
    readers += (readers.empty() ? "" : ", ") + other.header.name;
  }
  if (readers.empty()) return absl::OkStatus();
  return absl::FailedPreconditionError(header.name + " is the base of other jobs: delete " + readers + " first");
}

Status Ledger::CheckDeleted(const v1::JobDeleted& change) const {
  TESSERA_ASSIGN_OR_RETURN(const int named, ParseJobName(change.job()));
  if (expected_deleted_.contains(named) && (WasDeleted(named) || MayBeNext(named))) return absl::OkStatus();
  TESSERA_ASSIGN_OR_RETURN(const int index, FindJob(change.job()));
  return MayDelete(index);
}

Status Ledger::CheckRestarted(const v1::JobRestarted& change) const {
  TESSERA_ASSIGN_OR_RETURN(const int index, FindJob(change.job()));
  if (HasEnded(jobs_[index].header.state)) return absl::FailedPreconditionError(change.job() + " has ended");
  return absl::OkStatus();
}

void Ledger::FillJobsUpTo(int index) {
  while (static_cast<int>(jobs_.size()) < index) {
    const int number = static_cast<int>(jobs_.size());
    Job& filled = jobs_.emplace_back();
    filled.header.name = JobName(number);
    filled.deleted = expected_deleted_.contains(number);
    deleted_jobs_ += filled.deleted ? 1 : 0;
    filled.header.state = filled.deleted ? JobState::kCancelled : JobState::kFailed;
    if (!filled.deleted) filled.header.error = "its acceptance record cannot be used; submit the job again";
  }
}

void Ledger::ApplyDeleted(const v1::JobDeleted& change) {
  const int index = *ParseJobName(change.job());
  FillJobsUpTo(index + 1);
  Job& job = jobs_[index];
  if (job.deleted) return;
  std::erase_if(job_of_request_, [&](const auto& request) { return request.second == index; });
  ForgetSceneFiles(job);
  DropReady(index);  // tasks that recompute lost results
  DropRemakesOf(index);
  Job left;
  left.header.name = std::move(job.header.name);
  left.header.state = JobState::kCancelled;
  left.tasks = std::move(job.tasks);  // FreeDeleted frees them in steps
  left.deleted = true;
  ++deleted_jobs_;
  if (!left.tasks.empty()) to_free_.push_back(index);
  job = std::move(left);
}

void Ledger::ApplyRestarted(const v1::JobRestarted& change) {
  const int index = *FindJob(change.job());
  Job& job = jobs_[index];
  for (int task = 0; task < static_cast<int>(job.tasks.size()); ++task) ForgetTask({index, task});
  DropReady(index);
  // The new plan may not read the results that the old one waited for.
  for (const TaskRef ref : remakes_of_ended_) {
    std::erase_if(jobs_[ref.job].tasks[ref.task].awaited_by.Edit(),
                  [&](TaskRef waiting) { return waiting.job == index; });
  }
  Job anew;
  anew.header = std::move(job.header);
  anew.scene_files = std::move(job.scene_files);
  anew.header.state = JobState::kQueued;
  anew.header.start_us = 0;
  anew.header.warnings.push_back("restarted with algorithm version " + change.algorithm_version() +
                                 ": results of version " + anew.header.algorithm_version +
                                 " cannot be combined with its results");
  anew.header.algorithm_version = change.algorithm_version();
  job = std::move(anew);
  ready_.SetJob(index, job.header.priority, job.header.paused);
  UpdateDue(index);
}

bool Ledger::FreeDeleted(int max_tasks) {
  while (!to_free_.empty()) {
    const int index = to_free_.back();
    std::deque<JobTask>& tasks = jobs_[index].tasks;
    for (; max_tasks > 0 && !tasks.empty(); --max_tasks) {
      ForgetTask({index, static_cast<int>(tasks.size()) - 1});
      tasks.pop_back();
    }
    if (!tasks.empty()) return true;
    tasks.shrink_to_fit();
    to_free_.pop_back();
  }
  return false;
}

std::vector<std::string> Ledger::SceneFilesWith(const Digest& digest) const {
  std::vector<std::string> paths;
  const auto it = scene_files_of_sha256_.find(digest.sha256);
  if (it == scene_files_of_sha256_.end()) return paths;
  for (const ScenePath& each : it->second) paths.push_back(each.path);
  return paths;
}

void Ledger::ForgetSceneFiles(const Job& job) {
  for (const NamedDigest& file : job.scene_files) {
    if (!LiesInScene(file.name)) continue;
    const auto it = scene_files_of_sha256_.find(file.digest.sha256);
    if (it == scene_files_of_sha256_.end()) continue;
    std::vector<ScenePath>& paths = it->second;
    const std::string path = job.header.scene_path + "/" + file.name;
    const auto known = std::find_if(paths.begin(), paths.end(), [&](const auto& each) { return each.path == path; });
    if (known != paths.end() && --known->jobs == 0) paths.erase(known);
    if (paths.empty()) scene_files_of_sha256_.erase(it);
  }
}

}  // namespace tessera
