// File and folder operations. Durable writes use a temporary file, fsync, rename and fsync of the folder.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// All functions: paths are in the system's encoding; errors name the path and the system's reason (NOT_FOUND,
// PERMISSION_DENIED, RESOURCE_EXHAUSTED for a full disk, else INTERNAL). Thread-safe.

// The status of a failed system call: `what` and the text of `error` (an errno). IsFileError recognizes it, unless
// `error` is ENOENT, as long as the status stays in the process.
Status FileError(int error, const std::string& what);
bool IsFileError(const Status& status);

// The whole content. RESOURCE_EXHAUSTED if the file is larger than `max_bytes`.
StatusOr<std::string> ReadFile(const std::string& path, int64_t max_bytes = int64_t{4} << 30);

// Up to `size_bytes` bytes from `offset_bytes` on; fewer only at the end of the file.
StatusOr<std::string> ReadFileRange(const std::string& path, int64_t offset_bytes, int64_t size_bytes);

// The same from an open file; `path`: for errors.
StatusOr<std::string> ReadRange(int fd, const std::string& path, int64_t offset_bytes, int64_t size_bytes);

// Writes all bytes at the position of an open file. `what`: the beginning of the error's message.
Status WriteAll(int fd, std::string_view bytes, const std::string& what);

// Replaces the file atomically: after a crash it has either the old or the new content. `mode`: permissions, before the
// umask.
Status WriteFileAtomic(const std::string& path, const std::string& content, mode_t mode = 0644);

// Copies a file to `to`, which must not exist. The copy's bytes are durable on return.
Status CopyFileDurably(const std::string& from, const std::string& to);

// Renames within a file system and syncs the parent folder of `to`.
Status RenameDurably(const std::string& from, const std::string& to);

// Calls fsync on a file (its bytes become durable) or a folder (its names become durable).
Status SyncPath(const std::string& path);

// The absolute path in its shortest form: "/a/./b/" becomes "/a/b". Does not resolve links.
std::string AbsolutePath(const std::string& path);
// Creates the folder and its parents if they are missing.
Status EnsureFolder(const std::string& path);

// Creates the folder if it is missing and removes the permissions of group and others: from the folder and, if it had
// any, from all its content.
Status EnsurePrivateFolder(const std::string& path);

// Removes a file or a folder with its content, if it exists.
Status RemoveTree(const std::string& path);

// All regular files in `folder` and its subfolders (links are followed), relative to it, sorted.
StatusOr<std::vector<std::string>> ListFiles(const std::string& folder);

bool FileExists(const std::string& path);

// Changes when the file changes.
struct FileStamp {
  int64_t size_bytes = 0;
  int64_t modified_ns = 0;  // Unix time
  friend bool operator==(const FileStamp&, const FileStamp&) = default;
};
StatusOr<FileStamp> StampOf(const std::string& path);

// `name` joined to `folder`. INVALID_ARGUMENT if `name` is empty, absolute, or has "." or ".." parts: the result is
// always in the folder.
StatusOr<std::string> JoinInside(const std::string& folder, const std::string& name);

// A new empty folder, removed with its content on destruction. Movable.
class TempFolder {
 public:
  // Creates it in `parent`, which is created if missing; empty: the system's folder for temporary files.
  static StatusOr<TempFolder> Create(const std::string& parent, const std::string& prefix = "tessera-");
  TempFolder(TempFolder&& other) noexcept;
  TempFolder& operator=(TempFolder&& other) noexcept;
  ~TempFolder();
  const std::string& path() const { return path_; }

 private:
  explicit TempFolder(std::string path) : path_(std::move(path)) {}
  std::string path_;
};

// An exclusive lock (flock) on a file, released on destruction. Movable.
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
