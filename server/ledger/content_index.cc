#include "server/ledger/content_index.h"

#include <algorithm>

#include "common/job/task_parameters.h"

namespace tessera {

const absl::InlinedVector<StoredFile, 1>* ResultIndex::Find(const Sha256& key) const {
  const auto it = tasks_.find(key);
  for (TaskRef ref = it == tasks_.end() ? TaskRef() : *it; ref.job >= 0; ref = task(ref).older_with_key) {
    if (!(*jobs_)[ref.job].deleted) return &task(ref).outputs;
  }
  return nullptr;
}

void ResultIndex::Add(TaskRef ref) {
  TaskRef& older = task(ref).older_with_key;
  older = {};
  if (const auto last = tasks_.find(ref); last != tasks_.end()) {
    older = *last;
    tasks_.erase(last);
  }
  tasks_.insert(ref);
}

void ResultIndex::Remove(TaskRef ref) {
  const JobTask& removed = task(ref);
  const auto last = removed.key ? tasks_.find(ref) : tasks_.end();
  if (last == tasks_.end()) return;
  if (*last == ref) {
    tasks_.erase(last);
    if (removed.older_with_key.job >= 0) tasks_.insert(removed.older_with_key);
    return;
  }
  for (TaskRef newer = *last; newer.job >= 0; newer = task(newer).older_with_key) {
    TaskRef& older = task(newer).older_with_key;
    if (older != ref) continue;
    older = removed.older_with_key;
    return;
  }
}

void SceneFileIndex::Add(const Job& job) {
  for (const NamedDigest& file : job.scene_files) {
    if (!LiesInScene(file.name)) continue;
    std::vector<ScenePath>& paths = paths_of_sha256_[file.digest.sha256];
    const std::string path = job.header.scene_path + "/" + file.name;
    const auto known = std::find_if(paths.begin(), paths.end(), [&](const auto& each) { return each.path == path; });
    ++(known != paths.end() ? *known : paths.emplace_back(ScenePath{path})).jobs;
  }
}

void SceneFileIndex::Remove(const Job& job) {
  for (const NamedDigest& file : job.scene_files) {
    if (!LiesInScene(file.name)) continue;
    const auto it = paths_of_sha256_.find(file.digest.sha256);
    if (it == paths_of_sha256_.end()) continue;
    std::vector<ScenePath>& paths = it->second;
    const std::string path = job.header.scene_path + "/" + file.name;
    const auto known = std::find_if(paths.begin(), paths.end(), [&](const auto& each) { return each.path == path; });
    if (known != paths.end() && --known->jobs == 0) paths.erase(known);
    if (paths.empty()) paths_of_sha256_.erase(it);
  }
}

std::vector<std::string> SceneFileIndex::PathsOf(const Digest& digest) const {
  std::vector<std::string> paths;
  const auto it = paths_of_sha256_.find(digest.sha256);
  if (it == paths_of_sha256_.end()) return paths;
  for (const ScenePath& each : it->second) paths.push_back(each.path);
  return paths;
}

}  // namespace tessera
