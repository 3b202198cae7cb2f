#include "worker/agent/task_files.h"

#include <cstdio>
#include <filesystem>
#include <set>

namespace tessera {
namespace {

constexpr int64_t kMaxProbeBytes = 4096;

std::string MessageOf(const Status& status) { return std::string(status.message().data(), status.message().size()); }

// What a failed transfer means for the task: a full disk is no lack of memory, which is what RESOURCE_EXHAUSTED tells
// of a task; and a file that the coordinator finds changed since the job was submitted is an input that is wrong.
Status DiskStatus(const Status& status) {
  if (status.code() == absl::StatusCode::kFailedPrecondition) return absl::InvalidArgumentError(MessageOf(status));
  if (status.code() != absl::StatusCode::kResourceExhausted) return status;
  return absl::UnavailableError(MessageOf(status));
}

// For one file of a task's: the share of it that was moved becomes part of the stage, so that a long transfer is seen
// to go on. `control` must outlive it.
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

bool TaskFiles::Probe(const Registration& registration) {
  shared_blobs_ = nullptr;
  if (!use_shared_storage_ || registration.shared_blob_dir.empty() || registration.shared_probe_path.empty()) {
    return false;
  }
  const auto content = ReadFile(registration.shared_probe_path, kMaxProbeBytes);
  if (!content.ok() || *content != registration.shared_probe_content) return false;
  if (!std::filesystem::is_directory(registration.shared_blob_dir)) return false;
  auto store = BlobStore::Open(registration.shared_blob_dir);
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
    if (!after.ok() || !(*after == *stamp)) return false;  // written to while it was read
    verified_[path] = {*stamp, *found};
  }
  if (verified_[path].digest != digest) return false;
  in_use_.emplace_back(path, *stamp);
  return true;
}

StatusOr<std::string> TaskFiles::Locate(const TaskInput& input, const TaskControl& control) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(input.digest));
  if (use_shared_storage_ && !input.shared_path.empty() && ReadableAt(input.shared_path, input.digest)) {
    return input.shared_path;
  }
  if (shared_blobs_ != nullptr && ReadableAt(shared_blobs_->Path(input.digest), input.digest)) {
    return shared_blobs_->Path(input.digest);
  }
  const auto cached = cache_->Get(
      input.digest, [&](const Digest& digest, BlobStore& store) { return blobs_.Fetch(digest, store, control); });
  if (!cached.ok()) {
    const Status status = DiskStatus(cached.status());
    return Status(status.code(), "input " + input.name + ": " + MessageOf(status));
  }
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
  if (error) return absl::UnavailableError("cannot make " + link + ": " + error.message());
  links_.push_back(link);
  return absl::OkStatus();
}

Status TaskFiles::BringInputs(const std::vector<TaskInput>& inputs, const std::string& input_dir,
                              const TaskControl& control) {
  in_use_.clear();
  std::set<std::string> links, folders;
  for (const TaskInput& input : inputs) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    TESSERA_ASSIGN_OR_RETURN(const std::string link, JoinInside(input_dir, input.name));
    const TaskControl moving = Moving(control, 0, "bringing " + input.name);
    moving.Report(0, "");
    TESSERA_ASSIGN_OR_RETURN(const std::string file, Locate(input, moving));
    if (!links.insert(link).second) {
      return absl::InvalidArgumentError("two inputs of the task are named " + input.name);
    }
    const std::string folder = std::filesystem::path(link).parent_path().string();
    if (folders.insert(folder).second) TESSERA_RETURN_IF_ERROR(DiskStatus(EnsureFolder(folder)));
    TESSERA_RETURN_IF_ERROR(Link(file, link, std::filesystem::path(file).filename() == input.digest.sha256));
  }
  return absl::OkStatus();
}

Status TaskFiles::CheckInputsUnchanged() const {
  for (const auto& [path, stamp] : in_use_) {
    const auto now = StampOf(path);
    if (!now.ok() || !(*now == stamp)) {
      return absl::InvalidArgumentError(path + " was changed while a task read it; submit the job again");
    }
  }
  return absl::OkStatus();
}

StatusOr<Digest> TaskFiles::StoreOutput(const std::string& path, const TaskControl& control) {
  if (shared_blobs_ != nullptr) {
    const auto stored = shared_blobs_->MoveFile(path);
    if (stored.ok()) {
      // Often the next task's input: it has just been hashed.
      const std::string blob = shared_blobs_->Path(*stored);
      if (const auto stamp = StampOf(blob); stamp.ok()) verified_[blob] = {*stamp, *stored};
    }
    if (stored.ok() || stored.status().code() != absl::StatusCode::kPermissionDenied) return stored;
  }
  TESSERA_ASSIGN_OR_RETURN(const Digest digest, HashFile(path));
  TESSERA_RETURN_IF_ERROR(blobs_.Send(path, digest, control));
  TESSERA_RETURN_IF_ERROR(cache_->Adopt(path, digest));  // often the next task's input
  return digest;
}

StatusOr<std::vector<NamedDigest>> TaskFiles::StoreOutputs(const std::vector<std::string>& names,
                                                           const std::string& output_dir, const TaskControl& control) {
  std::vector<NamedDigest> outputs;
  for (const std::string& name : names) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    const auto path = JoinInside(output_dir, name);
    if (!path.ok() || !FileExists(*path))
      return absl::InternalError("the task named an output that is not there: " + name);
    const TaskControl moving = Moving(control, 1, "storing " + name);
    moving.Report(0, "");
    const auto digest = StoreOutput(*path, moving);
    if (!digest.ok()) {
      const Status status = DiskStatus(digest.status());
      return Status(status.code(), "output " + name + ": " + MessageOf(status));
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
