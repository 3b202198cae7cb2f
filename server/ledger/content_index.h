// Indices from content to the tasks and scene files that have it.
#pragma once

#include <string>
#include <unordered_map>
#include <vector>

#include "absl/container/flat_hash_set.h"
#include "absl/hash/hash.h"
#include "server/ledger/job.h"

namespace tessera {

// Succeeded tasks by key. The set stores indices because a city has millions of keys. It has the newest task of each
// key, and JobTask::older_with_key links the older ones. Not thread-safe.
class ResultIndex {
 public:
  // `jobs` must outlive the index. Tasks in it may be freed only after Remove.
  explicit ResultIndex(std::vector<Job>* jobs) : jobs_(jobs) {}
  ResultIndex(const ResultIndex&) = delete;
  ResultIndex& operator=(const ResultIndex&) = delete;

  // Precondition: the task has a key.
  void Add(TaskRef ref);
  // No effect if the task is absent.
  void Remove(TaskRef ref);
  // Outputs of an earlier task with this key, of a job that was not deleted; null if none is known.
  const absl::InlinedVector<StoredFile, 1>* Find(const Sha256& key) const;
  // Call if the blobs of the result are no longer stored.
  void Forget(const Sha256& key) { tasks_.erase(key); }

 private:
  struct HashOfKey {
    using is_transparent = void;
    size_t operator()(const Sha256& key) const { return absl::Hash<Sha256>()(key); }
    size_t operator()(TaskRef ref) const { return (*this)(*index->task(ref).key); }
    const ResultIndex* index;
  };
  struct SameKey {
    using is_transparent = void;
    const Sha256& KeyOf(const Sha256& key) const { return key; }
    const Sha256& KeyOf(TaskRef ref) const { return *index->task(ref).key; }
    template <class A, class B>
    bool operator()(const A& a, const B& b) const {
      return KeyOf(a) == KeyOf(b);
    }
    const ResultIndex* index;
  };
  JobTask& task(TaskRef ref) const { return (*jobs_)[ref.job].tasks[ref.task]; }

  std::vector<Job>* const jobs_;
  absl::flat_hash_set<TaskRef, HashOfKey, SameKey> tasks_{0, HashOfKey{this}, SameKey{this}};
};

// Absolute paths of scene files by the content that they had when their jobs were accepted. Not thread-safe.
class SceneFileIndex {
 public:
  void Add(const Job& job);
  void Remove(const Job& job);
  // Of the oldest job first.
  std::vector<std::string> PathsOf(const Digest& digest) const;

 private:
  struct ScenePath {
    std::string path;
    int jobs = 0;  // number of jobs with this path
  };
  std::unordered_map<std::string, std::vector<ScenePath>> paths_of_sha256_;
};

}  // namespace tessera
