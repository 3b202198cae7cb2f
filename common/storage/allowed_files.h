// Files that others name: opened only if they lie where they may, and known by what was opened, not by their path.
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

// An open regular file. Movable; const members are thread-safe.
class HeldFile {
 public:
  HeldFile(HeldFile&& other) noexcept;
  HeldFile& operator=(HeldFile&& other) noexcept;
  ~HeldFile();

  // A path that opens this very file again, whatever its name leads to by now; for as long as this object lives.
  const std::string& path() const { return path_; }
  // Where it was when it was opened, without links.
  const std::string& real_path() const { return real_path_; }
  // Its size and when its inode was last changed, which unlike the time of writing nobody can set.
  StatusOr<FileStamp> Stamp() const;
  StatusOr<std::string> Read(int64_t offset_bytes, int64_t size_bytes) const;
  // CANCELLED once `cancelled` says so; it may be empty.
  StatusOr<Digest> Hash(const std::function<bool()>& cancelled) const;

 private:
  friend class AllowedFiles;
  HeldFile(int fd, std::string path, std::string real_path)
      : fd_(fd), path_(std::move(path)), real_path_(std::move(real_path)) {}
  int fd_;
  std::string path_, real_path_;
};

// Which files may be read. A plain value; thread-safe.
class AllowedFiles {
 public:
  // All regular files that the process may read, for who reads what is his own.
  static AllowedFiles All() { return AllowedFiles(); }
  // Those whose real path is under one of the folders, links between them included. NOT_FOUND for a folder that is not
  // there.
  static StatusOr<AllowedFiles> Under(const std::vector<std::string>& folders);
  // Those that belong to the user.
  static AllowedFiles OwnedBy(uid_t user);

  // Opens the file at an absolute path. INVALID_ARGUMENT, with what was found, for what is not allowed: another place
  // or owner, no regular file, a file of a pseudo file system, one above 1 TiB, a large one that is all but empty
  // (sparse), a name with control characters or that is not UTF-8. Nothing outside is touched, so that the answer does
  // not tell whether there is anything. NOT_FOUND if inside there is none. Never waits for who writes to a pipe.
  StatusOr<HeldFile> Open(const std::string& path) const;
  // The whole content; RESOURCE_EXHAUSTED above `max_bytes`.
  StatusOr<std::string> ReadWhole(const std::string& path, int64_t max_bytes) const;
  // False if there is nothing of that name; true also where it leads outside.
  bool Exists(const std::string& path) const;
  // Whether the path is a folder's; an error if it leads outside.
  StatusOr<bool> IsFolder(const std::string& path) const;
  // Every regular file under the folder, relative to it, sorted; links followed as far as they lead inside.
  // RESOURCE_EXHAUSTED above a million entries.
  StatusOr<std::vector<std::string>> List(const std::string& folder) const;

 private:
  AllowedFiles() = default;
  bool restricted() const { return !folders_.empty() || owner_.has_value(); }
  bool IsInside(const std::string& real_path) const;
  // Whether the path is inside, or one passes through it on the way there.
  bool MayPass(const std::string& real_path) const;
  Status Outside(const std::string& path) const;
  // The path without links. Errors as Open's.
  StatusOr<std::string> Resolve(const std::string& path) const;
  Status ListInto(const std::string& folder, const std::string& prefix, std::vector<std::string>& parents,
                  int64_t& entries, std::vector<std::string>& files) const;

  std::vector<std::string> folders_;  // real paths
  std::vector<std::string> named_;    // as they were given, by way of links perhaps
  std::optional<uid_t> owner_;
};

}  // namespace tessera
