// Files and folders, with durability where it matters: temporary name, sync, rename, sync of the folder.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// All functions: paths are in the system's encoding; errors name the path and the system's reason (NOT_FOUND,
// PERMISSION_DENIED, RESOURCE_EXHAUSTED for a full disk, else INTERNAL). Thread-safe.

// What a failed call of the file system gives: `what` and the system's words for `error` (an errno). But for a file
// that is not there it is marked, so that IsFileError knows it, whatever its code, as long as it is passed on in one
// process.
Status FileError(int error, const std::string& what);
bool IsFileError(const Status& status);

// The whole content. RESOURCE_EXHAUSTED if the file is larger than `max_bytes`.
StatusOr<std::string> ReadFile(const std::string& path, int64_t max_bytes = int64_t{4} << 30);

// Up to `size_bytes` bytes from `offset_bytes` on; fewer only at the end of the file.
StatusOr<std::string> ReadFileRange(const std::string& path, int64_t offset_bytes, int64_t size_bytes);

// Replaces `path` by a file with this content: after a crash the old or the new content is there, never a part.
// `mode`: who may do what with it, less the process's umask.
Status WriteFileAtomic(const std::string& path, const std::string& content, mode_t mode = 0644);

// Copies a file to `to`, which must not be there; the copy's bytes are durable when this returns.
Status CopyFileDurably(const std::string& from, const std::string& to);

// Renames within a file system and syncs the folder of `to`.
Status RenameDurably(const std::string& from, const std::string& to);

// Makes the bytes of an existing file (or the names in a folder) survive a crash.
Status SyncPath(const std::string& path);

// Makes the folder and its parents; nothing if it is there.
Status EnsureFolder(const std::string& path);

// Makes the folder, or takes all that others may do there from them: from the folder, and, if it was open to them, from
// all that is in it.
Status EnsurePrivateFolder(const std::string& path);

// Removes a file or a folder with all that is in it; nothing if it is not there.
Status RemoveTree(const std::string& path);

// Every regular file under `folder` (links followed), relative to it, sorted.
StatusOr<std::vector<std::string>> ListFiles(const std::string& folder);

bool FileExists(const std::string& path);

// What tells that a file was changed.
struct FileStamp {
  int64_t size_bytes = 0;
  int64_t modified_ns = 0;  // Unix time
  friend bool operator==(const FileStamp&, const FileStamp&) = default;
};
StatusOr<FileStamp> StampOf(const std::string& path);

// `name` joined to `folder`; INVALID_ARGUMENT if `name` is empty, absolute, or has "." or ".." parts, so that a name
// from outside never leaves the folder.
StatusOr<std::string> JoinInside(const std::string& folder, const std::string& name);

// A new empty folder, removed with its content on destruction. Movable.
class TempFolder {
 public:
  // Makes it in `parent` (made if missing); empty: the system's folder for temporary files.
  static StatusOr<TempFolder> Create(const std::string& parent, const std::string& prefix = "tessera-");
  TempFolder(TempFolder&& other) noexcept;
  TempFolder& operator=(TempFolder&& other) noexcept;
  ~TempFolder();
  const std::string& path() const { return path_; }

 private:
  explicit TempFolder(std::string path) : path_(std::move(path)) {}
  std::string path_;
};

// Holds a file locked (flock) against other processes while it lives. Movable.
class FileLock {
 public:
  // FAILED_PRECONDITION if another process holds it.
  static StatusOr<FileLock> Acquire(const std::string& path);
  FileLock(FileLock&& other) noexcept;
  FileLock& operator=(FileLock&& other) noexcept;
  ~FileLock();

 private:
  explicit FileLock(int fd) : fd_(fd) {}
  int fd_;
};

}  // namespace tessera
