// A coordinator's state in PostgreSQL, which another coordinator can take over.
#pragma once

#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "server/store/state_store.h"

namespace tessera {

// The right to write is the row of table `coordinator`: an epoch, which each opening raises, and the time of its last
// renewal by the database's clock. Every write is one statement that does nothing unless the epoch is still this
// store's, so a process that was stopped or cut off can neither write after a takeover nor keep a lock.
class PostgresStore : public StateStore {
 public:
  static StatusOr<std::unique_ptr<PostgresStore>> Open(const std::string& url, const OpenStateOptions& options);
  ~PostgresStore() override;

  Status Append(const std::vector<std::string_view>& records, Durability durability) override;
  Status Replay(const std::function<void(const StoredRecord& record)>& visit) override;
  Status Quarantine(int64_t number, const std::string& reason) override;
  StatusOr<std::set<int>> DeletedJobs() override;
  StatusOr<int> RemoveRecords(int max_records) override;
  // The epoch.
  int64_t StartCount() const override;
  std::optional<Digest> Find(const std::string& path, const FileStamp& stamp) override;
  Status Remember(const std::string& path, const FileStamp& stamp, const Digest& digest) override;
  std::string Location() const override;
  StatusOr<std::string> WorkerKey() override;
  StatusOr<std::string> Keep(const std::string& name, const std::string& value) override;
  Status Replace(const std::string& name, const std::string& value) override;
  double HeldFor_s() const override;
  Status Export(const RowSink& visit) override;
  Status Import(const std::function<Status(const RowSink& add)>& fill, int64_t starts) override;
  void Release() override;

 private:
  struct Impl;
  explicit PostgresStore(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
