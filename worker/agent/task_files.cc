#include "worker/agent/task_files.h"

#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <limits>
#include <set>
#include <utility>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int64_t kMaxProbeBytes = 4096;

// Why an input could not be fetched. kLostInput: the coordinator checks its own copy.
Failure WhyNotBrought(const TaskInput& input, const Status& status) {
  const std::string message = "input " + input.name + ": " + MessageOf(status);
  if (IsFileError(status)) return {FailureClass::kScratch, message};
  switch (status.code()) {
    case absl::StatusCode::kNotFound:
    case absl::StatusCode::kDataLoss:
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kInvalidArgument:
      return {FailureClass::kLostInput, message, {input.digest}};
    default:
      return {FailureClass::kPeer, message};
  }
}

// Whether the store may accept the output later: it is full, or its folder cannot be written now.
bool MayPass(const Status& status) { return IsFileError(status) || absl::IsResourceExhausted(status); }

// Several files that are moved at once. Reports them as one stage ("fetching inputs: 3 of 50, 1.2 of 10.0 MB"), so that
// a long transfer shows progress, and cancels the files after one that failed. Thread-safe.
class FileMoves {
 public:
  // `control` must outlive this. `fraction`: of the task.
  FileMoves(const TaskControl& control, double fraction, std::string stage, std::vector<int64_t> sizes)
      : control_(control),
        fraction_(fraction),
        stage_(std::move(stage)),
        sizes_(std::move(sizes)),
        moved_(sizes_.size()) {
    for (const int64_t bytes : sizes_) all_bytes_ += bytes;
  }

  // Calls move(i) for each file. It returns whether the files after it are still needed.
  void ForEach(const std::function<bool(int64_t i)>& move) {
    ConcurrentForEach(static_cast<int64_t>(sizes_.size()), BlobStore::kCallsAtOnce, [&](int64_t i) {
      if (IsCancelled(i)) return;
      SetMoved(i, 0, 0);
      if (move(i)) return SetMoved(i, 1, 1);
      for (int64_t first = failed_; i < first && !failed_.compare_exchange_weak(first, i);) {
      }
    });
  }

  // The control of a file, whose reported fraction is its moved share.
  TaskControl Of(int64_t i) {
    TaskControl control;
    control.cancelled = [this, i] { return IsCancelled(i); };
    control.report = [this, i](double share, const std::string& reason) { SetMoved(i, share, 0, reason); };
    return control;
  }
  void Report(const std::string& stage) {
    std::lock_guard lock(mutex_);
    control_.Report(fraction_, stage);
  }

 private:
  bool IsCancelled(int64_t i) {
    if (failed_ < i) return true;
    std::lock_guard lock(mutex_);
    return !control_.Check().ok();
  }
  // `reason`: why the file waits; empty: it does not.
  void SetMoved(int64_t i, double share, int done, const std::string& reason = "") {
    std::lock_guard lock(mutex_);
    const auto bytes = static_cast<int64_t>(share * static_cast<double>(sizes_[i]));
    moved_bytes_ += bytes - std::exchange(moved_[i], bytes);
    done_ += done;
    char numbers[96];
    std::snprintf(numbers, sizeof(numbers), ": %d of %zu, %.1f of %.1f MB", done_, sizes_.size(),
                  static_cast<double>(moved_bytes_) / 1e6, static_cast<double>(all_bytes_) / 1e6);
    control_.Report(fraction_, stage_ + numbers + (reason.empty() ? "" : ": " + reason));
  }

  const TaskControl& control_;
  const double fraction_;
  const std::string stage_;
  const std::vector<int64_t> sizes_;
  int64_t all_bytes_ = 0;
  std::atomic<int64_t> failed_ = std::numeric_limits<int64_t>::max();  // the first file that failed
  std::mutex mutex_;                                                   // of the members below and of calls of control_
  std::vector<int64_t> moved_;                                         // bytes
  int64_t moved_bytes_ = 0;
  int done_ = 0;
};

}  // namespace

std::string MessageOf(const Status& status) { return std::string(status.message().data(), status.message().size()); }

bool TaskFiles::Probe(const Registration& registration) {
  shared_blobs_ = nullptr;
  if (!use_shared_storage_ || registration.shared_blob_dir.empty() || registration.shared_probe_path.empty()) {
    return false;
  }
  // The coordinator could not read the files of another user.
  struct stat info;
  if (::stat(registration.shared_blob_dir.c_str(), &info) != 0 || info.st_uid != ::geteuid()) return false;
  const auto content = ReadFile(registration.shared_probe_path, kMaxProbeBytes);
  if (!content.ok() || *content != registration.shared_probe_content) return false;
  if (!std::filesystem::is_directory(registration.shared_blob_dir)) return false;
  auto store = FolderBlobs::Open(registration.shared_blob_dir);
  if (!store.ok()) return false;
  shared_blobs_ = *std::move(store);
  return true;
}

std::optional<Digest> TaskFiles::VerifiedAt(const std::string& path, const FileStamp& stamp) {
  std::lock_guard lock(verified_mutex_);
  const auto known = verified_.find(path);
  if (known == verified_.end() || !(known->second.stamp == stamp)) return std::nullopt;
  return known->second.digest;
}

void TaskFiles::NoteVerified(const std::string& path, const FileStamp& stamp, const Digest& digest) {
  std::lock_guard lock(verified_mutex_);
  verified_[path] = {stamp, digest};
}

std::optional<TaskFiles::UsedFile> TaskFiles::ReadableAt(const std::string& path, const Digest& digest) {
  const auto stamp = StampOf(path);
  if (!stamp.ok() || stamp->size_bytes != digest.size_bytes) return std::nullopt;
  std::optional<Digest> content = VerifiedAt(path, *stamp);
  if (!content) {
    const auto found = HashFile(path);
    if (!found.ok()) return std::nullopt;
    const auto after = StampOf(path);
    if (!after.ok() || !(*after == *stamp)) return std::nullopt;  // changed while it was read
    NoteVerified(path, *stamp, *found);
    content = *found;
  }
  if (*content != digest) return std::nullopt;
  return UsedFile{path, *stamp, digest};
}

std::string TaskFiles::SharedPath(const Digest& digest) const {
  return shared_blobs_ == nullptr ? "" : shared_blobs_->LocalPath(digest).value_or("");
}

std::vector<std::string> TaskFiles::SharedPaths(const TaskInput& input) const {
  std::vector<std::string> paths;
  if (use_shared_storage_ && !input.shared_path.empty()) paths.push_back(input.shared_path);
  if (std::string path = SharedPath(input.digest); !path.empty()) paths.push_back(std::move(path));
  return paths;
}

std::optional<TaskFiles::UsedFile> TaskFiles::KnownAt(const TaskInput& input) {
  if (!CheckDigest(input.digest).ok()) return std::nullopt;
  for (const std::string& path : SharedPaths(input)) {
    const auto stamp = StampOf(path);
    if (!stamp.ok()) continue;
    const std::optional<Digest> content = VerifiedAt(path, *stamp);
    if (content && *content == input.digest) return UsedFile{path, *stamp, input.digest};
  }
  return std::nullopt;
}

StatusOr<TaskFiles::UsedFile> TaskFiles::Locate(const TaskInput& input, const TaskControl& control) {
  if (const Status named = CheckDigest(input.digest); !named.ok()) {
    return AsStatus(FailureClass::kInput, MessageOf(named));
  }
  for (const std::string& path : SharedPaths(input)) {
    if (auto file = ReadableAt(path, input.digest)) return *std::move(file);
  }
  const auto cached = cache_->Get(
      input.digest, [&](const Digest& digest, BlobStore& store) { return blobs_.Fetch(digest, store, control); });
  if (absl::IsCancelled(cached.status())) return cached.status();
  if (!cached.ok()) return AsStatus(WhyNotBrought(input, cached.status()));
  return UsedFile{*cached, StampOf(*cached).value_or(FileStamp()), input.digest};
}

Status TaskFiles::Link(const std::string& file, const std::string& link, bool is_blob) {
  const std::filesystem::path target = std::filesystem::absolute(file);
  std::error_code error;
  if (is_blob) std::filesystem::create_hard_link(target, link, error);
  if (!is_blob || error) {  // another file system, or one without hard links
    error.clear();
    std::filesystem::create_symlink(target, link, error);
  }
  if (error) return AsStatus(FailureClass::kScratch, "cannot create link " + link + ": " + error.message());
  links_.push_back(link);
  return absl::OkStatus();
}

Status TaskFiles::BringInputs(const std::vector<TaskInput>& inputs, const std::string& input_dir,
                              const TaskControl& control) {
  std::vector<std::string> links;
  std::set<std::string> names, folders;
  for (const TaskInput& input : inputs) {
    const auto link = JoinInside(input_dir, input.name);
    if (!link.ok()) return AsStatus(FailureClass::kInput, MessageOf(link.status()));
    if (!names.insert(*link).second) {
      return AsStatus(FailureClass::kInput, "found two inputs of the same name: " + input.name);
    }
    links.push_back(*link);
  }
  std::vector<StatusOr<UsedFile>> found(inputs.size(), absl::CancelledError("cancelled"));
  // Most inputs of a step are files that this worker knows: no calls are made and no threads are started for these.
  std::vector<size_t> others;
  std::vector<int64_t> sizes;
  std::vector<Digest> to_fetch;  // from an object store, perhaps
  for (size_t i = 0; i < inputs.size(); ++i) {
    if (std::optional<UsedFile> known = KnownAt(inputs[i])) {
      found[i] = *std::move(known);
      continue;
    }
    others.push_back(i);
    sizes.push_back(inputs[i].digest.size_bytes);
    if (inputs[i].shared_path.empty() && !cache_->Holds(inputs[i].digest)) to_fetch.push_back(inputs[i].digest);
  }
  if (to_fetch.size() > 1) blobs_.Prepare(to_fetch);
  FileMoves moves(control, 0, "fetching inputs", std::move(sizes));
  moves.ForEach([&](int64_t k) {
    const size_t i = others[static_cast<size_t>(k)];
    found[i] = Locate(inputs[i], moves.Of(k));
    return found[i].ok() || FailureOf(found[i].status()).failure_class == FailureClass::kLostInput;
  });
  Failure lost;  // all lost inputs are reported together
  for (size_t i = 0; i < inputs.size(); ++i) {
    if (found[i].ok()) continue;
    const Failure failure = FailureOf(found[i].status());
    if (failure.failure_class != FailureClass::kLostInput) return found[i].status();
    if (lost.lost_inputs.empty()) lost = {FailureClass::kLostInput, failure.message};
    lost.lost_inputs.push_back(inputs[i].digest);
  }
  if (!lost.lost_inputs.empty()) return AsStatus(lost);
  for (size_t i = 0; i < inputs.size(); ++i) {
    const std::string folder = std::filesystem::path(links[i]).parent_path().string();
    if (folders.insert(folder).second) {
      const Status made = EnsureFolder(folder);
      if (!made.ok()) return AsStatus(FailureClass::kScratch, MessageOf(made));
    }
    const bool is_blob = std::filesystem::path(found[i]->path).filename() == inputs[i].digest.sha256;
    TESSERA_RETURN_IF_ERROR(Link(found[i]->path, links[i], is_blob));
    in_use_.push_back(*std::move(found[i]));
  }
  return absl::OkStatus();
}

Status TaskFiles::CheckInputs(bool read) {
  Failure lost;
  for (const UsedFile& file : in_use_) {
    const auto now = StampOf(file.path);
    bool same = now.ok() && *now == file.stamp;
    if (same && read) {
      const auto found = HashFile(file.path);
      same = found.ok() && *found == file.digest;
    }
    if (same) continue;
    verified_.erase(file.path);
    if (lost.lost_inputs.empty()) lost = {FailureClass::kLostInput, file.path + " was changed while a task read it"};
    lost.lost_inputs.push_back(file.digest);
  }
  return lost.lost_inputs.empty() ? absl::OkStatus() : AsStatus(lost);
}

StatusOr<Digest> TaskFiles::StoreOnce(const std::string& path, const TaskControl& control) {
  if (shared_blobs_ != nullptr) {
    const auto stored = shared_blobs_->MoveFile(path);
    if (stored.ok()) {
      // Often an input of the next task: MoveFile has hashed it, so no second hash is needed.
      const std::string blob = SharedPath(*stored);
      if (const auto stamp = StampOf(blob); stamp.ok()) NoteVerified(blob, *stamp, *stored);
    }
    if (stored.ok() || stored.status().code() != absl::StatusCode::kPermissionDenied) return stored;
  }
  TESSERA_ASSIGN_OR_RETURN(const Digest digest, HashFile(path));
  TESSERA_RETURN_IF_ERROR(blobs_.Send(path, digest, control));
  if (!cache_->Adopt(path, digest).ok()) std::remove(path.c_str());  // only a cache of a likely next input
  return digest;
}

StatusOr<Digest> TaskFiles::StoreOutput(const std::string& path, const TaskControl& control,
                                        const std::function<void(const std::string& stage)>& report) {
  Backoff backoff(storage_wait_.retry);
  for (double waited_s = 0;;) {
    const auto stored = StoreOnce(path, control);
    if (stored.ok() || !MayPass(stored.status()) || waited_s >= storage_wait_.limit_s) return stored;
    const double delay_s = backoff.NextDelay();
    waited_s += delay_s;
    char seconds[32];
    std::snprintf(seconds, sizeof(seconds), "%.0f", waited_s);
    report("waiting for storage space since " + std::string(seconds) + " s: " + MessageOf(stored.status()));
    if (!storage_wait_.sleeper(delay_s)) return absl::CancelledError("cancelled while waiting for storage space");
  }
}

StatusOr<std::vector<NamedDigest>> TaskFiles::StoreOutputs(const std::vector<std::string>& names,
                                                           const std::string& output_dir, const TaskControl& control) {
  std::vector<std::string> paths;
  std::vector<int64_t> sizes;
  std::set<std::string> known;
  for (const std::string& name : names) {
    const auto path = JoinInside(output_dir, name);
    const auto stamp = path.ok() ? StampOf(*path) : StatusOr<FileStamp>(path.status());
    if (!stamp.ok() || !known.insert(*path).second) {
      return AsStatus(FailureClass::kInternal, "the task did not write the output that it reported: " + name);
    }
    paths.push_back(*path);
    sizes.push_back(stamp->size_bytes);
  }
  std::vector<StatusOr<Digest>> stored(names.size(), absl::CancelledError("cancelled"));
  FileMoves moves(control, 1, "storing outputs", std::move(sizes));
  moves.ForEach([&](int64_t i) {
    stored[i] = StoreOutput(paths[i], moves.Of(i), [&](const std::string& stage) { moves.Report(stage); });
    return stored[i].ok();
  });
  std::vector<NamedDigest> outputs;
  for (size_t i = 0; i < names.size(); ++i) {
    const Status& status = stored[i].status();
    if (absl::IsCancelled(status)) return status;
    if (!status.ok()) {
      return AsStatus(MayPass(status) ? FailureClass::kStorage : FailureClass::kPeer,
                      "output " + names[i] + ": " + MessageOf(status));
    }
    outputs.push_back({names[i], *stored[i]});
  }
  return outputs;
}

void TaskFiles::Release() {
  in_use_.clear();
  std::error_code ignored;
  for (const std::string& link : links_) std::filesystem::remove(link, ignored);
  links_.clear();
  cache_->Release();
}

}  // namespace tessera
