// RecordStore and DigestCache in one SQLite file (write-ahead log, synced as each batch of records asks).
#ifndef TESSERA_SERVER_STORE_SQLITE_STORE_H_
#define TESSERA_SERVER_STORE_SQLITE_STORE_H_

#include <memory>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "server/store/record_store.h"

namespace tessera {

class SqliteStore : public RecordStore, public DigestCache {
 public:
  // Opens or makes the file; one of the version before is migrated, with a copy of it left beside it.
  // FAILED_PRECONDITION if it is another program's or of another version; DATA_LOSS if it is damaged. `owner_of`:
  // without it records are nobody's, and stay.
  static StatusOr<std::unique_ptr<SqliteStore>> Open(const std::string& path, OwnerOf owner_of = {});
  ~SqliteStore() override;

  Status Append(const std::vector<std::string_view>& records, Durability durability) override;
  Status Replay(const std::function<void(const StoredRecord& record)>& visit) override;
  Status SetAside(int64_t number, const std::string& reason) override;
  StatusOr<std::set<int>> DeletedJobs() override;
  StatusOr<int> RemoveRecords(int max_records) override;
  int64_t StartCount() const override;
  std::optional<Digest> Find(const std::string& path, const FileStamp& stamp) override;
  Status Remember(const std::string& path, const FileStamp& stamp, const Digest& digest) override;

 private:
  struct Impl;
  explicit SqliteStore(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// Copies the database of a store, which may be in use, to a file that is replaced, whole or not at all: the records as
// they are now. A store on the copy gives no start count that one on the original gives.
Status BackUp(const std::string& database, const std::string& to);

}  // namespace tessera

#endif  // TESSERA_SERVER_STORE_SQLITE_STORE_H_
