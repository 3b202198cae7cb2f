#include "common/storage/blob_sweep.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <utility>

#include "common/storage/files.h"
#include "common/storage/hash.h"
#include "common/storage/temporary_name.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using Kind = BlobFile::Kind;

int64_t Micros(const timespec& time) { return time.tv_sec * 1'000'000 + time.tv_nsec / 1000; }

// A blob that is stored again is touched, not written: BlobStore::Touch.
int64_t StoredSince(const struct stat& info) { return std::max(Micros(info.st_mtim), Micros(info.st_atim)); }

}  // namespace

std::vector<BlobFile> ListBlobFiles(const std::string& root, int part) {
  constexpr char kDigits[] = "0123456789abcdef";
  const Kind in_part = part == kBlobParts - 1   ? Kind::kSetAside
                       : part == kBlobParts - 2 ? Kind::kLeftover
                                                : Kind::kBlob;
  const std::string folder = root + "/" +
                             (in_part == Kind::kSetAside   ? "set_aside"
                              : in_part == Kind::kLeftover ? "partial"
                                                           : std::string{kDigits[part / 16], kDigits[part % 16]});
  std::vector<BlobFile> files;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    struct stat info {};
    const std::string path = it->path().string(), name = it->path().filename().string();
    if (::lstat(path.c_str(), &info) != 0 || !S_ISREG(info.st_mode)) continue;
    // Being set aside is being renamed, which changes the time of change alone.
    const int64_t since_us = in_part == Kind::kSetAside ? Micros(info.st_ctim) : StoredSince(info);
    BlobFile file{path, in_part, "", info.st_size, since_us};
    if (in_part == Kind::kBlob && CheckDigest({name, file.size_bytes}).ok()) {
      file.sha256 = name;
    } else if (in_part == Kind::kBlob) {
      if (name.find(".tmp-") == std::string::npos) continue;
      file.kind = Kind::kLeftover;
    }
    files.push_back(std::move(file));
  }
  return files;
}

StatusOr<std::string> TakeOut(const std::string& root, const BlobFile& file) {
  const std::string taken = root + "/partial/removed-" + UniqueName();
  const auto fault = [&] { return "cannot take out " + file.path + ": " + std::strerror(errno); };
  if (std::rename(file.path.c_str(), taken.c_str()) != 0) {
    return errno == ENOENT ? absl::NotFoundError(fault()) : absl::InternalError(fault());
  }
  struct stat info {};
  if (file.kind != Kind::kBlob || (::lstat(taken.c_str(), &info) == 0 && StoredSince(info) == file.since_us)) {
    return taken;
  }
  if (::link(taken.c_str(), file.path.c_str()) != 0 && errno != EEXIST) return absl::InternalError(fault());
  std::remove(taken.c_str());
  TESSERA_RETURN_IF_ERROR(SyncPath(fs::path(file.path).parent_path().string()));
  return absl::NotFoundError(file.path + " was stored again");
}

}  // namespace tessera
