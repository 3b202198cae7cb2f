#include "common/exporting/folder/staging.h"

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr char kStagingName[] = ".export";
constexpr char kStagingLock[] = "lock";

StatusOr<std::vector<std::string>> NamesIn(const std::string& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    names.push_back(entry->path().filename().string());
  }
  if (error) return FileError(error.value(), absl::StrCat("cannot list ", folder));
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace

StatusOr<ExportStaging> ExportStaging::Open(const std::string& out) {
  ExportStaging staging(AbsolutePath(out));
  const bool exists = FileExists(out);
  std::error_code error;
  if (exists && !fs::is_directory(out, error)) {
    return absl::AlreadyExistsError(absl::StrCat(out, ": found a file, expected a new or empty folder"));
  }
  TESSERA_RETURN_IF_ERROR(EnsureFolder(out));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> names, NamesIn(out));
  const std::string path = absl::StrCat(staging.out_, "/", kStagingName);
  if (!names.empty() && !FileExists(path)) {
    return absl::AlreadyExistsError(
        absl::StrCat(out,
                     ": found a folder with files, expected a new or empty one: name another with --out, or "
                     "remove it"));
  }
  TESSERA_RETURN_IF_ERROR(EnsureFolder(path));
  StatusOr<FileLock> lock = FileLock::Acquire(absl::StrCat(path, "/", kStagingLock));
  if (absl::IsFailedPrecondition(lock.status())) {
    return absl::FailedPreconditionError(
        absl::StrCat(out, ": another export writes to this folder: wait for it, or name another with --out"));
  }
  TESSERA_RETURN_IF_ERROR(lock.status());
  staging.lock_ = *std::move(lock);
  staging.path_ = path;
  staging.made_out_ = !exists;
  TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> left, NamesIn(path));
  for (const std::string& name : left) {
    if (name != kStagingLock) TESSERA_RETURN_IF_ERROR(RemoveTree(absl::StrCat(path, "/", name)));
  }
  return staging;
}

ExportStaging::ExportStaging(ExportStaging&& other) noexcept
    : out_(std::exchange(other.out_, {})),
      path_(std::exchange(other.path_, {})),
      made_out_(other.made_out_),
      lock_(std::exchange(other.lock_, std::nullopt)) {}

ExportStaging::~ExportStaging() {
  if (path_.empty()) return;
  RemoveTree(path_).IgnoreError();
  if (made_out_) rmdir(out_.c_str());  // fails if it has files
}

StatusOr<std::string> ExportStaging::Folder(const std::string& name) const {
  const std::string folder = absl::StrCat(path_, "/", name);
  TESSERA_RETURN_IF_ERROR(EnsureFolder(folder));
  return folder;
}

Status ExportStaging::Publish(const std::string& folder, const std::string& last) const {
  TESSERA_ASSIGN_OR_RETURN(std::vector<std::string> names, NamesIn(folder));
  std::stable_partition(names.begin(), names.end(), [&](const std::string& name) { return name != last; });
  for (const std::string& name : names) {
    const std::string to = absl::StrCat(out_, "/", name);
    TESSERA_RETURN_IF_ERROR(RemoveTree(to));  // of an interrupted export
    TESSERA_RETURN_IF_ERROR(RenameDurably(absl::StrCat(folder, "/", name), to));
  }
  return absl::OkStatus();
}

}  // namespace tessera
