// Zip archives from outside, read member by member within bounds; nothing is written to disk.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// Whether a file that begins with `head` is a zip archive.
bool IsZip(std::string_view head);

// An open archive. Movable, not thread-safe.
class ZipFile {
 public:
  // INVALID_ARGUMENT for a file that is no archive, or has more than 100,000 members, two of one name, or names that
  // are absolute or lead out of the archive. Errors as ReadFile if the file cannot be read.
  static StatusOr<ZipFile> Open(const std::string& path);
  // The same from memory; `name` is the file's name in messages.
  static StatusOr<ZipFile> Parse(std::string bytes, const std::string& name);
  ZipFile(ZipFile&&) noexcept;
  ZipFile& operator=(ZipFile&&) noexcept;
  ~ZipFile();

  const std::string& name() const;
  // The members, without folders, in the order of the archive.
  const std::vector<std::string>& members() const;
  bool Has(const std::string& member) const;
  // A member's bytes. INVALID_ARGUMENT if it does not exist, is larger than `max_bytes`, encrypted, compressed by
  // another method than deflate or damaged, or if all members read are larger than 8 GiB together.
  StatusOr<std::string> Read(const std::string& member, int64_t max_bytes);
  // The first bytes of a member, at most `max_bytes`; empty if it cannot be read.
  std::string ReadHead(const std::string& member, int64_t max_bytes);

 private:
  struct Impl;
  explicit ZipFile(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
