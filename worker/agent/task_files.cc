#include "worker/agent/task_files.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <set>

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

// Reports the transferred share of one file as part of the stage, so that a long transfer shows progress. `control`
// must outlive the result.
TaskControl Moving(const TaskControl& control, double fraction, const std::string& stage) {
  TaskControl moving;
  moving.cancelled = control.cancelled;
  moving.report = [&control, fraction, stage](double share, const std::string&) {
    char percent[32];
    std::snprintf(percent, sizeof(percent), " (%.1f %%)", 100 * share);
    control.Report(fraction, stage + percent);
  };
  return moving;
}

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

bool TaskFiles::ReadableAt(const std::string& path, const Digest& digest) {
  const auto stamp = StampOf(path);
  if (!stamp.ok() || stamp->size_bytes != digest.size_bytes) return false;
  const auto known = verified_.find(path);
  if (known == verified_.end() || !(known->second.stamp == *stamp)) {
    const auto found = HashFile(path);
    if (!found.ok()) return false;
    const auto after = StampOf(path);
    if (!after.ok() || !(*after == *stamp)) return false;  // changed while it was read
    verified_[path] = {*stamp, *found};
  }
  if (verified_[path].digest != digest) return false;
  in_use_.push_back({path, *stamp, digest});
  return true;
}

std::string TaskFiles::SharedPath(const Digest& digest) const {
  return shared_blobs_ == nullptr ? "" : shared_blobs_->LocalPath(digest).value_or("");
}

StatusOr<std::string> TaskFiles::Locate(const TaskInput& input, const TaskControl& control) {
  if (const Status named = CheckDigest(input.digest); !named.ok()) {
    return AsStatus(FailureClass::kInput, MessageOf(named));
  }
  if (use_shared_storage_ && !input.shared_path.empty() && ReadableAt(input.shared_path, input.digest)) {
    return input.shared_path;
  }
  if (const std::string path = SharedPath(input.digest); !path.empty() && ReadableAt(path, input.digest)) return path;
  const auto cached = cache_->Get(
      input.digest, [&](const Digest& digest, BlobStore& store) { return blobs_.Fetch(digest, store, control); });
  if (absl::IsCancelled(cached.status())) return cached;
  if (!cached.ok()) return AsStatus(WhyNotBrought(input, cached.status()));
  in_use_.push_back({*cached, StampOf(*cached).value_or(FileStamp()), input.digest});
  return *cached;
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
  std::set<std::string> links, folders;
  Failure lost;
  for (const TaskInput& input : inputs) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    const auto link = JoinInside(input_dir, input.name);
    if (!link.ok()) return AsStatus(FailureClass::kInput, MessageOf(link.status()));
    const TaskControl moving = Moving(control, 0, "fetching " + input.name);
    moving.Report(0, "");
    const StatusOr<std::string> file = Locate(input, moving);
    if (const Failure failure = FailureOf(file.status()); failure.failure_class == FailureClass::kLostInput) {
      if (lost.lost_inputs.empty()) lost = {FailureClass::kLostInput, failure.message};
      lost.lost_inputs.push_back(input.digest);
      continue;  // all lost inputs are reported together
    }
    if (!file.ok()) return file.status();
    if (!links.insert(*link).second) {
      return AsStatus(FailureClass::kInput, "found two inputs of the same name: " + input.name);
    }
    const std::string folder = std::filesystem::path(*link).parent_path().string();
    if (folders.insert(folder).second) {
      const Status made = EnsureFolder(folder);
      if (!made.ok()) return AsStatus(FailureClass::kScratch, MessageOf(made));
    }
    TESSERA_RETURN_IF_ERROR(Link(*file, *link, std::filesystem::path(*file).filename() == input.digest.sha256));
  }
  return lost.lost_inputs.empty() ? absl::OkStatus() : AsStatus(lost);
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
      if (const auto stamp = StampOf(blob); stamp.ok()) verified_[blob] = {*stamp, *stored};
    }
    if (stored.ok() || stored.status().code() != absl::StatusCode::kPermissionDenied) return stored;
  }
  TESSERA_ASSIGN_OR_RETURN(const Digest digest, HashFile(path));
  TESSERA_RETURN_IF_ERROR(blobs_.Send(path, digest, control));
  if (!cache_->Adopt(path, digest).ok()) std::remove(path.c_str());  // only a cache of a likely next input
  return digest;
}

StatusOr<Digest> TaskFiles::StoreOutput(const std::string& path, const TaskControl& moving,
                                        const TaskControl& control) {
  Backoff backoff(storage_wait_.retry);
  for (double waited_s = 0;;) {
    const auto stored = StoreOnce(path, moving);
    if (stored.ok() || !MayPass(stored.status()) || waited_s >= storage_wait_.limit_s) return stored;
    const double delay_s = backoff.NextDelay();
    waited_s += delay_s;
    char seconds[32];
    std::snprintf(seconds, sizeof(seconds), "%.0f", waited_s);
    control.Report(1, "waiting for storage space since " + std::string(seconds) + " s: " + MessageOf(stored.status()));
    if (!storage_wait_.sleeper(delay_s)) return absl::CancelledError("cancelled while waiting for storage space");
  }
}

StatusOr<std::vector<NamedDigest>> TaskFiles::StoreOutputs(const std::vector<std::string>& names,
                                                           const std::string& output_dir, const TaskControl& control) {
  std::vector<NamedDigest> outputs;
  for (const std::string& name : names) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    const auto path = JoinInside(output_dir, name);
    if (!path.ok() || !FileExists(*path)) {
      return AsStatus(FailureClass::kInternal, "the task did not write the output that it reported: " + name);
    }
    const TaskControl moving = Moving(control, 1, "storing " + name);
    moving.Report(0, "");
    const auto digest = StoreOutput(*path, moving, control);
    if (absl::IsCancelled(digest.status())) return digest.status();
    if (!digest.ok()) {
      return AsStatus(MayPass(digest.status()) ? FailureClass::kStorage : FailureClass::kPeer,
                      "output " + name + ": " + MessageOf(digest.status()));
    }
    outputs.push_back({name, *digest});
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
