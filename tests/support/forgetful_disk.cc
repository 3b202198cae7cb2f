#include "tests/support/forgetful_disk.h"

#include <gtest/gtest.h>
#include <sqlite3.h>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <new>
#include <utility>

#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr size_t kSectorBytes = 512;
constexpr int kKept = SQLITE_OPEN_MAIN_DB | SQLITE_OPEN_MAIN_JOURNAL | SQLITE_OPEN_WAL;  // kinds of files
constexpr char kName[] = "forgetful";

ForgetfulDisk* disk = nullptr;      // the only one
sqlite3_vfs* real_disk = nullptr;   // SQLite's own
sqlite3_vfs* shown_disk = nullptr;  // what stands before it

}  // namespace

// A file as SQLite knows it; the real one lies behind it in the same memory.
struct DiskFile {
  sqlite3_file base;
  std::string path;
  bool kept = false;  // whether its changes are recorded

  static DiskFile* Of(sqlite3_file* file) { return reinterpret_cast<DiskFile*>(file); }
  // SQLite aligns what it gives to 8 bytes.
  static constexpr size_t Bytes();
  static sqlite3_file* Real(sqlite3_file* file);

  static int Close(sqlite3_file* file) {
    const int code = Real(file)->pMethods->xClose(Real(file));
    if (Of(file)->kept) {
      std::lock_guard lock(disk->mutex_);
      --disk->open_;
    }
    Of(file)->~DiskFile();
    return code;
  }
  static int Read(sqlite3_file* file, void* bytes, int size, sqlite3_int64 offset) {
    return Real(file)->pMethods->xRead(Real(file), bytes, size, offset);
  }
  static int Write(sqlite3_file* file, const void* bytes, int size, sqlite3_int64 offset) {
    using Change = ForgetfulDisk::Change;
    const std::string content(static_cast<const char*>(bytes), static_cast<size_t>(size));
    if (Stops(file, Change{Change::Kind::kWrite, offset, content}, false)) return SQLITE_IOERR_WRITE;
    return Real(file)->pMethods->xWrite(Real(file), bytes, size, offset);
  }
  static int Truncate(sqlite3_file* file, sqlite3_int64 size) {
    using Change = ForgetfulDisk::Change;
    if (Stops(file, Change{Change::Kind::kTruncate, size, ""}, false)) return SQLITE_IOERR_TRUNCATE;
    return Real(file)->pMethods->xTruncate(Real(file), size);
  }
  // The real file need not be synced: the machine stops here alone.
  static int Sync(sqlite3_file* file, int) { return Stops(file, std::nullopt, true) ? SQLITE_IOERR_FSYNC : SQLITE_OK; }
  static int FileSize(sqlite3_file* file, sqlite3_int64* size) {
    return Real(file)->pMethods->xFileSize(Real(file), size);
  }
  static int Lock(sqlite3_file* file, int kind) { return Real(file)->pMethods->xLock(Real(file), kind); }
  static int Unlock(sqlite3_file* file, int kind) { return Real(file)->pMethods->xUnlock(Real(file), kind); }
  static int CheckReservedLock(sqlite3_file* file, int* result) {
    return Real(file)->pMethods->xCheckReservedLock(Real(file), result);
  }
  static int FileControl(sqlite3_file* file, int what, void* argument) {
    return Real(file)->pMethods->xFileControl(Real(file), what, argument);
  }
  static int SectorSize(sqlite3_file* file) { return Real(file)->pMethods->xSectorSize(Real(file)); }
  static int DeviceCharacteristics(sqlite3_file* file) {
    return Real(file)->pMethods->xDeviceCharacteristics(Real(file));
  }
  static int ShmMap(sqlite3_file* file, int region, int size, int extend, void volatile** memory) {
    return Real(file)->pMethods->xShmMap(Real(file), region, size, extend, memory);
  }
  static int ShmLock(sqlite3_file* file, int offset, int count, int flags) {
    return Real(file)->pMethods->xShmLock(Real(file), offset, count, flags);
  }
  static void ShmBarrier(sqlite3_file* file) { Real(file)->pMethods->xShmBarrier(Real(file)); }
  static int ShmUnmap(sqlite3_file* file, int drop) { return Real(file)->pMethods->xShmUnmap(Real(file), drop); }

  static bool Stops(sqlite3_file* file, std::optional<ForgetfulDisk::Change> change, bool sync) {
    return Of(file)->kept && disk->Step(Of(file)->path, std::move(change), sync);
  }

  static int Open(sqlite3_vfs*, const char* path, sqlite3_file* file, int flags, int* out_flags) {
    static constexpr sqlite3_io_methods kMethods = {2,
                                                    Close,
                                                    Read,
                                                    Write,
                                                    Truncate,
                                                    Sync,
                                                    FileSize,
                                                    Lock,
                                                    Unlock,
                                                    CheckReservedLock,
                                                    FileControl,
                                                    SectorSize,
                                                    DeviceCharacteristics,
                                                    ShmMap,
                                                    ShmLock,
                                                    ShmBarrier,
                                                    ShmUnmap,
                                                    nullptr,
                                                    nullptr};
    DiskFile* opened = new (file) DiskFile{};
    opened->path = path == nullptr ? "" : path;
    opened->kept = (flags & kKept) != 0;
    Real(file)->pMethods = nullptr;
    const bool there = opened->kept && std::filesystem::exists(path);
    const int code = real_disk->xOpen(real_disk, path, Real(file), flags, out_flags);
    if (code != SQLITE_OK) {
      opened->~DiskFile();
      file->pMethods = nullptr;
      return code;
    }
    opened->base.pMethods = &kMethods;
    if (!opened->kept) return SQLITE_OK;
    std::lock_guard lock(disk->mutex_);
    ++disk->open_;
    const auto [content, is_new] = disk->files_.try_emplace(opened->path);
    if (is_new && there) content->second.synced = ReadFile(path).value();  // from before this disk
    return SQLITE_OK;
  }
  static int Delete(sqlite3_vfs*, const char* path, int sync_folder) {
    bool kept = false;
    {
      std::lock_guard lock(disk->mutex_);
      kept = disk->files_.contains(path);
    }
    using Change = ForgetfulDisk::Change;
    if (kept && disk->Step(path, Change{Change::Kind::kDelete, 0, ""}, sync_folder != 0)) return SQLITE_IOERR_DELETE;
    return real_disk->xDelete(real_disk, path, 0);
  }
};

constexpr size_t DiskFile::Bytes() { return (sizeof(DiskFile) + 7) / 8 * 8; }
sqlite3_file* DiskFile::Real(sqlite3_file* file) {
  return reinterpret_cast<sqlite3_file*>(reinterpret_cast<char*>(file) + Bytes());
}

ForgetfulDisk::ForgetfulDisk() {
  EXPECT_EQ(disk, nullptr) << "one forgetful disk at a time";
  disk = this;
  real_disk = sqlite3_vfs_find(nullptr);
  shown_disk = new sqlite3_vfs(*real_disk);
  shown_disk->szOsFile = static_cast<int>(DiskFile::Bytes()) + real_disk->szOsFile;
  shown_disk->zName = kName;
  shown_disk->xOpen = DiskFile::Open;
  shown_disk->xDelete = DiskFile::Delete;
  EXPECT_EQ(sqlite3_vfs_register(shown_disk, /*makeDflt=*/1), SQLITE_OK);
}

ForgetfulDisk::~ForgetfulDisk() {
  EXPECT_EQ(open_, 0);
  sqlite3_vfs_unregister(shown_disk);
  sqlite3_vfs_register(real_disk, /*makeDflt=*/1);
  delete shown_disk;
  disk = nullptr;
}

void ForgetfulDisk::StopAtStep(int64_t step) {
  std::lock_guard lock(mutex_);
  stop_at_ = steps_ + step;
}

bool ForgetfulDisk::stopped() const {
  std::lock_guard lock(mutex_);
  return stopped_;
}

int64_t ForgetfulDisk::steps() const {
  std::lock_guard lock(mutex_);
  return steps_;
}

bool ForgetfulDisk::Step(const std::string& path, std::optional<Change> change, bool sync) {
  std::lock_guard lock(mutex_);
  if (stopped_) return true;
  stopped_ = ++steps_ == stop_at_;
  Content& content = files_[path];
  if (change) content.since.push_back(*std::move(change));
  if (stopped_ || !sync) return stopped_;
  const bool is_new = !content.synced;
  if (is_new) content.synced = "";
  for (const Change& one : content.since) Apply(one, &content.synced);
  content.since.clear();
  // SQLite's own disk syncs the folder with a new journal or log, and with a deletion that asks for it.
  if (is_new || !content.synced) SyncFolder(std::filesystem::path(path).parent_path());
  return false;
}

void ForgetfulDisk::SyncFolder(const std::string& folder) {
  for (auto& [path, content] : files_) {
    if (std::filesystem::path(path).parent_path() != folder) continue;
    const auto is_deletion = [](const Change& change) { return change.kind == Change::Kind::kDelete; };
    const auto last = std::find_if(content.since.rbegin(), content.since.rend(), is_deletion).base();
    if (last == content.since.begin()) continue;
    content.synced.reset();
    content.since.erase(content.since.begin(), last);
  }
}

void ForgetfulDisk::Apply(const Change& change, std::optional<std::string>* content) {
  if (change.kind == Change::Kind::kDelete) {
    content->reset();
    return;
  }
  if (!*content) *content = "";
  std::string& bytes = **content;
  const auto offset = static_cast<size_t>(change.offset);
  if (change.kind == Change::Kind::kTruncate) {
    bytes.resize(offset);
    return;
  }
  bytes.resize(std::max(bytes.size(), offset + change.bytes.size()));
  std::copy(change.bytes.begin(), change.bytes.end(), bytes.begin() + change.offset);
}

std::optional<std::string> ForgetfulDisk::After(const Content& content, Left left, Random& random) {
  std::optional<std::string> after = content.synced;
  if (left == Left::kNothing || content.since.empty()) return after;
  if (left == Left::kAll) {
    for (const Change& change : content.since) Apply(change, &after);
    return after;
  }
  if (left == Left::kFirst) {
    const auto whole = static_cast<size_t>(random.Below(static_cast<int64_t>(content.since.size())));
    for (size_t i = 0; i < whole; ++i) Apply(content.since[i], &after);
    Change torn = content.since[whole];
    if (torn.kind != Change::Kind::kWrite) return after;
    const auto sectors = static_cast<int64_t>(torn.bytes.size() / kSectorBytes);
    torn.bytes.resize(static_cast<size_t>(random.Below(sectors + 1)) * kSectorBytes);
    if (!torn.bytes.empty()) Apply(torn, &after);
    return after;
  }
  for (const Change& change : content.since) {
    if (change.kind != Change::Kind::kWrite) {
      if (random.Below(2) == 0) Apply(change, &after);
      continue;
    }
    for (size_t begin = 0; begin < change.bytes.size(); begin += kSectorBytes) {
      if (random.Below(2) == 0) continue;
      const auto offset = change.offset + static_cast<int64_t>(begin);
      Apply({change.kind, offset, change.bytes.substr(begin, kSectorBytes)}, &after);
    }
  }
  return after;
}

void ForgetfulDisk::Restart(Left left, Random& random) {
  std::lock_guard lock(mutex_);
  ASSERT_EQ(open_, 0) << "a database is still open";
  for (auto& [path, content] : files_) {
    content.synced = After(content, left, random);
    content.since.clear();
    std::filesystem::remove(path);
    std::filesystem::remove(path + "-shm");  // memory
    if (content.synced) std::ofstream(path, std::ios::binary) << *content.synced;
  }
  stopped_ = false;
  stop_at_ = -1;
}

}  // namespace tessera
