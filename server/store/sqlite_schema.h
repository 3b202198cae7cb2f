// The tables of a store, their migration, and copies of the database.
#pragma once

#include <string>

#include "common/base/status.h"
#include "server/store/record_store.h"

struct sqlite3;

namespace tessera {

// Creates the tables of a new file. Migrates those of the previous version in one transaction, after copying the file
// to PATH.v3. FAILED_PRECONDITION if the file belongs to another program or has an unsupported version; it is unchanged
// then. `owner_of` may be empty.
Status PrepareSchema(sqlite3* db, const std::string& path, const OwnerOf& owner_of);

// Copies a snapshot of the database to `to`, atomically; replaces an existing file. Concurrent writes are not blocked
// and are not in the copy. `change`: SQL to run on the copy.
Status CopyDatabase(sqlite3* db, const std::string& path, const std::string& to, const std::string& change = "");

}  // namespace tessera
