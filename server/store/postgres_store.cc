#include "server/store/postgres_store.h"

#include <utility>

namespace tessera {
namespace {

Status Unfinished() { return absl::UnimplementedError("PostgreSQL is not supported yet"); }

}  // namespace

struct PostgresStore::Impl {};

PostgresStore::PostgresStore(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PostgresStore::~PostgresStore() = default;

StatusOr<std::unique_ptr<PostgresStore>> PostgresStore::Open(const std::string&, const OpenStateOptions&) {
  return Unfinished();
}

Status PostgresStore::Append(const std::vector<std::string_view>&, Durability) { return Unfinished(); }
Status PostgresStore::Replay(const std::function<void(const StoredRecord& record)>&) { return Unfinished(); }
Status PostgresStore::Quarantine(int64_t, const std::string&) { return Unfinished(); }
StatusOr<std::set<int>> PostgresStore::DeletedJobs() { return Unfinished(); }
StatusOr<int> PostgresStore::RemoveRecords(int) { return Unfinished(); }
int64_t PostgresStore::StartCount() const { return 0; }
std::optional<Digest> PostgresStore::Find(const std::string&, const FileStamp&) { return std::nullopt; }
Status PostgresStore::Remember(const std::string&, const FileStamp&, const Digest&) { return Unfinished(); }
std::string PostgresStore::Location() const { return ""; }
StatusOr<std::string> PostgresStore::WorkerKey() { return Unfinished(); }
StatusOr<std::string> PostgresStore::Keep(const std::string&, const std::string&) { return Unfinished(); }
Status PostgresStore::Replace(const std::string&, const std::string&) { return Unfinished(); }
StatusOr<std::optional<std::string>> ReadKept(const std::string&, const std::string&) { return Unfinished(); }
double PostgresStore::HeldFor_s() const { return 0; }
void PostgresStore::Release() {}

}  // namespace tessera
