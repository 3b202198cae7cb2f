// The tables of a store, those of earlier versions, and copies of the whole.
#ifndef TESSERA_SERVER_STORE_SQLITE_SCHEMA_H_
#define TESSERA_SERVER_STORE_SQLITE_SCHEMA_H_

#include <string>

#include "common/base/status.h"
#include "server/store/record_store.h"

struct sqlite3;

namespace tessera {

// Makes the tables of a new file. Those of the version before become this one's in one transaction, after a copy of the
// file was put beside it (PATH.v3). FAILED_PRECONDITION if the file is another program's or of a version that this one
// knows nothing of; then nothing was changed. `owner_of`: may be empty.
Status PrepareSchema(sqlite3* db, const std::string& path, const OwnerOf& owner_of);

// DATA_LOSS with what SQLite finds wrong in the file, and how to go on.
Status CheckIntegrity(sqlite3* db, const std::string& path);

// Copies the database as it is now to a file, whole or not at all: what is written meanwhile waits for nothing and is
// not in the copy. A file at `to` is replaced. `change`: SQL that the copy differs by.
Status CopyDatabase(sqlite3* db, const std::string& path, const std::string& to, const std::string& change = "");

}  // namespace tessera

#endif  // TESSERA_SERVER_STORE_SQLITE_SCHEMA_H_
