#include "server/store/state_store.h"

#include "server/store/postgres_store.h"
#include "server/store/sqlite_store.h"

namespace tessera {

bool IsTakenOver(const Status& status) { return status.code() == absl::StatusCode::kAborted; }

bool IsPostgresUrl(const std::string& url) {
  return url.starts_with("postgresql://") || url.starts_with("postgres://");
}

StatusOr<std::unique_ptr<StateStore>> OpenState(const std::string& url, const OpenStateOptions& options) {
  if (IsPostgresUrl(url)) return PostgresStore::Open(url, options);
  return SqliteStore::OpenLocked(url, options.owner_of);
}

}  // namespace tessera
