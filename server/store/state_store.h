// The whole state of a coordinator in a database, and the exclusive right to write it.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "common/base/status.h"
#include "server/store/record_store.h"
#include "server/store/state_copy.h"

namespace tessera {

// A store that was opened holds the right to write. Append, and all other functions that write, return ABORTED and
// store nothing once another coordinator has taken it (IsTakenOver). While the database cannot be reached they return
// UNAVAILABLE after some seconds. An Append whose answer was lost may be repeated with the same records: no record is
// stored twice. The destructor releases the right. Thread-safe.
class StateStore : public RecordStore, public DigestCache {
 public:
  // Where the state is, for messages: a path, or the URL of a database without its password.
  virtual std::string Location() const = 0;
  // Secret from which the secrets of workers are derived. Made at the first call, and kept with the state: a
  // coordinator that takes over accepts the workers of the one before.
  virtual StatusOr<std::string> WorkerKey() = 0;
  // A value that is kept with the state under `name`. Returns the kept one; stores `value` if there is none yet.
  virtual StatusOr<std::string> Keep(const std::string& name, const std::string& value) = 0;
  // Keeps `value` under `name`, in place of an earlier one.
  virtual Status Replace(const std::string& name, const std::string& value) = 0;

  // Seconds by this process's monotonic clock for which the right to write is certainly held; infinity if no other
  // process can take it (SQLite: the data folder is locked). 0 or less: the process must answer nothing more. Never
  // waits for the database.
  virtual double HeldFor_s() const = 0;
  // Calls `visit` for every row of every table of StateTables, by table and primary key. Returns its first error.
  virtual Status Export(const RowSink& visit) = 0;
  // Stores the rows that `fill` passes on, or none of them, in place of what an empty state has; the start count
  // becomes at least `starts`. FAILED_PRECONDITION if there are records. Releases the right to write.
  virtual Status Import(const std::function<Status(const RowSink& add)>& fill, int64_t starts) = 0;

  // Gives the right to write up at once, so that a standby need not wait. Append returns ABORTED from then on.
  virtual void Release() = 0;
};

// Whether a status of Append means that another coordinator has taken over.
bool IsTakenOver(const Status& status);

struct OpenStateOptions {
  OwnerOf owner_of = {};
  std::string holder = "";  // who opens it, for messages: host and process
  // Called about four times a second while another coordinator holds the right: who, and how many seconds ago it was
  // last renewed. False ends the wait with CANCELLED. Empty: does not wait, FAILED_PRECONDITION instead. Not used for
  // SQLite, whose data folder another process has locked: FAILED_PRECONDITION at once.
  std::function<bool(const std::string& holder, double renewed_before_s)> wait = {};
};

// Opens the state at `url`, or creates an empty one: a path of a SQLite file, or postgresql://..., as libpq reads it
// (its service and password files, sslmode, several hosts). The search_path selects one of several coordinators in a
// database: postgresql://HOST/DATABASE?options=-csearch_path%3DNAME; the schema NAME is created if it is missing.
// FAILED_PRECONDITION if another coordinator holds the right to write and `wait` is empty, and for a database of
// another program or a newer version; UNAVAILABLE if the database cannot be reached. No error has a password.
StatusOr<std::unique_ptr<StateStore>> OpenState(const std::string& url, const OpenStateOptions& options);

// The value that StateStore::Keep or Replace keeps under `name`, for processes without the right to write; nullopt if
// there is none, or no state yet. UNAVAILABLE if the database cannot be reached. Only for PostgreSQL.
StatusOr<std::optional<std::string>> ReadKept(const std::string& url, const std::string& name);

// Whether `url` names a PostgreSQL database.
bool IsPostgresUrl(const std::string& url);
// Whether it does and contains a password or the passphrase of a key.
bool HasPassword(const std::string& url);

}  // namespace tessera
