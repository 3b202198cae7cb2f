// A coordinator's state in one SQLite file (write-ahead log; synced for Durability::kMachine).
#pragma once

#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "server/store/state_store.h"

namespace tessera {

class SqliteStore : public StateStore {
 public:
  // Opens or creates the file. A file of the previous version is migrated, and a copy of it is kept.
  // FAILED_PRECONDITION if the file belongs to another program or version; DATA_LOSS if it is damaged. Without
  // `owner_of`, records belong to no job and are never removed. Does not lock the folder.
  static StatusOr<std::unique_ptr<SqliteStore>> Open(const std::string& path, OwnerOf owner_of = {});
  // Locks the file's folder (its file `lock`) first, until Release. FAILED_PRECONDITION if another process has done so.
  static StatusOr<std::unique_ptr<SqliteStore>> OpenLocked(const std::string& path, OwnerOf owner_of);
  ~SqliteStore() override;

  Status Append(const std::vector<std::string_view>& records, Durability durability) override;
  Status Replay(const std::function<void(const StoredRecord& record)>& visit) override;
  Status Quarantine(int64_t number, const std::string& reason) override;
  StatusOr<std::set<int>> DeletedJobs() override;
  StatusOr<int> RemoveRecords(int max_records) override;
  int64_t StartCount() const override;
  std::optional<Digest> Find(const std::string& path, const FileStamp& stamp) override;
  Status Remember(const std::string& path, const FileStamp& stamp, const Digest& digest) override;
  std::string Location() const override;
  // Moves the key of the file `worker.key` beside the database, where earlier releases kept it, into the database.
  StatusOr<std::string> WorkerKey() override;
  StatusOr<std::string> Keep(const std::string& name, const std::string& value) override;
  Status Replace(const std::string& name, const std::string& value) override;
  double HeldFor_s() const override;
  Status Export(const RowSink& visit) override;
  Status Import(const std::function<Status(const RowSink& add)>& fill, int64_t starts) override;
  void Release() override;

 private:
  struct Impl;
  explicit SqliteStore(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// Copies a snapshot of a store's database, which may be in use, to `to`, atomically; replaces an existing file. Start
// counts of the copy and of the original never coincide.
Status BackUp(const std::string& database, const std::string& to);

}  // namespace tessera
