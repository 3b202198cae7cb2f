// The tables of a coordinator's state in PostgreSQL.
#pragma once

#include "common/base/status.h"
#include "server/store/postgres_connection.h"

namespace tessera {

// Finds the schema that `target` selects (the first of its search_path), creates it and its tables in one transaction
// if they are missing, and sets it in `target`. FAILED_PRECONDITION if the schema has tables of another program or of a
// newer version; nothing is changed then. Several processes may call it at once.
Status PreparePostgresSchema(PostgresTarget& target);

// Finds and sets the schema without creating anything. Returns whether it has a state.
StatusOr<bool> FindPostgresSchema(PostgresTarget& target);

}  // namespace tessera
