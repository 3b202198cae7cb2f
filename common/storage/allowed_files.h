// Opens files at paths that users supply, if the files are in allowed folders or have an allowed owner.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"

namespace tessera {

// An open regular file. Keeps its content if the path is replaced. Movable; const members are thread-safe.
class AllowedFile {
 public:
  AllowedFile(AllowedFile&& other) noexcept;
  AllowedFile& operator=(AllowedFile&& other) noexcept;
  ~AllowedFile();

  // A path that opens the same file again, even if its name was replaced. Valid as long as this object.
  const std::string& path() const { return path_; }
  // The path at the time of opening, with links resolved.
  const std::string& real_path() const { return real_path_; }
  // Size and inode change time. Users cannot set the latter, unlike the modification time.
  StatusOr<FileStamp> Stamp() const;
  // The modification time (Unix time), which users can set.
  StatusOr<int64_t> ModifiedNs() const;
  StatusOr<std::string> Read(int64_t offset_bytes, int64_t size_bytes) const;
  // CANCELLED if `cancelled` returns true. It may be empty.
  StatusOr<Digest> Hash(const std::function<bool()>& cancelled) const;

 private:
  friend class AllowedFiles;
  AllowedFile(int fd, std::string path, std::string real_path)
      : fd_(fd), path_(std::move(path)), real_path_(std::move(real_path)) {}
  int fd_;
  std::string path_, real_path_;
};

// The set of files that may be read. Thread-safe.
class AllowedFiles {
 public:
  // All regular files that the process can read. For programs that a user runs on their own files.
  static AllowedFiles All() { return AllowedFiles(); }
  // Files whose real path is in one of the folders. Links from one folder to another are followed. NOT_FOUND for a
  // missing folder.
  static StatusOr<AllowedFiles> Under(const std::vector<std::string>& folders);
  // Files that the user owns.
  static AllowedFiles OwnedBy(uid_t user);

  // Opens the file at an absolute path. NOT_FOUND for a missing file in an allowed folder. INVALID_ARGUMENT for a file
  // outside the allowed folders or of another owner, one that is not regular, in a pseudo file system, above 1 TiB or
  // sparse (and large), and for a name with control characters or invalid UTF-8. Errors do not reveal whether a file
  // outside exists. Does not block on pipes.
  StatusOr<AllowedFile> Open(const std::string& path) const;
  // The whole content; RESOURCE_EXHAUSTED above `max_bytes`.
  StatusOr<std::string> ReadWhole(const std::string& path, int64_t max_bytes) const;
  // Whether the name exists. Also true if it leads outside the allowed folders.
  bool Exists(const std::string& path) const;
  // Whether the path is a folder. INVALID_ARGUMENT if it leads outside the allowed folders.
  StatusOr<bool> IsFolder(const std::string& path) const;
  // All files in the folder and its subfolders, relative to it, sorted. Follows links; INVALID_ARGUMENT for one that
  // leads outside the allowed folders. RESOURCE_EXHAUSTED above a million entries.
  StatusOr<std::vector<std::string>> List(const std::string& folder) const;

 private:
  AllowedFiles() = default;
  bool restricted() const { return !folders_.empty() || owner_.has_value(); }
  bool IsInside(const std::string& real_path) const;
  // Whether the path is in an allowed folder or is a parent of one.
  bool MayPass(const std::string& real_path) const;
  Status Outside(const std::string& path) const;
  // The path with links resolved. Errors as Open.
  StatusOr<std::string> Resolve(const std::string& path) const;
  Status ListInto(const std::string& folder, const std::string& prefix, std::vector<std::string>& parents,
                  int64_t& entries, std::vector<std::string>& files) const;

  std::vector<std::string> folders_;  // real paths
  std::vector<std::string> named_;    // as given to Under; may contain links
  std::optional<uid_t> owner_;
};

}  // namespace tessera
