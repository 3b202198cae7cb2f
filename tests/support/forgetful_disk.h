// A SQLite VFS that simulates machine failure: data that was not synced is lost.
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/base/random.h"

namespace tessera {

// While one lives, every database of this process that is opened without naming a VFS is on it. It stands before
// SQLite's own VFS: files are where they are named, reads and locks are the real ones. What changes databases, their
// logs and their journals (a write, a truncation, a deletion, a sync) is a step; steps are counted, and the machine can
// be made to stop at any of them. One at a time. Thread-safe but for Restart.
class ForgetfulDisk {
 public:
  // What is left of the steps since the last sync of a file.
  enum class Left {
    kNothing,
    kFirst,     // of each file the first so many, the last of them torn
    kAnything,  // of each file some sectors (512 bytes) of some of them
    kAll,       // the process was killed, its machine lives on
  };

  ForgetfulDisk();
  ~ForgetfulDisk();
  ForgetfulDisk(const ForgetfulDisk&) = delete;
  ForgetfulDisk& operator=(const ForgetfulDisk&) = delete;

  // The machine stops at the step so many from now, counted from 1: it is begun but not finished (a sync syncs
  // nothing), and it and all after it fail.
  void StopAtStep(int64_t step);
  bool stopped() const;
  // So far.
  int64_t steps() const;

  // The machine stops, if it has not, and starts again: files are as they were synced, with what `left` says of what
  // came later. No database may be open.
  void Restart(Left left, Random& random);

 private:
  friend struct DiskFile;  // SQLite's side

  struct Change {
    enum class Kind { kWrite, kTruncate, kDelete } kind;
    int64_t offset = 0;  // kTruncate: the new size
    std::string bytes;
  };
  struct Content {
    std::optional<std::string> synced;  // none: there is no such file
    std::vector<Change> since;
  };

  void SyncFolder(const std::string& folder);  // deletions in it are kept
  static void Apply(const Change& change, std::optional<std::string>* content);
  static std::optional<std::string> After(const Content& content, Left left, Random& random);
  // Counts a step that changes the file; whether the machine stopped at it or before. `sync`: all until now is kept.
  bool Step(const std::string& path, std::optional<Change> change, bool sync);

  mutable std::mutex mutex_;
  std::map<std::string, Content> files_;
  int64_t steps_ = 0, stop_at_ = -1;
  bool stopped_ = false;
  int open_ = 0;
};

}  // namespace tessera
