#include "server/store/postgres_schema.h"

#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"

namespace tessera {
namespace {

constexpr int kVersion = 1;  // of the tables, and of the records in them
constexpr double kLimit_s = 10;

// As in sqlite_schema.cc. Strings are bytes: type text takes only what is valid in the database's encoding. The start
// count is the epoch. A later version adds its changes as a script of its own, which the store runs in one transaction
// after it has taken the right to write: an older coordinator may still be active before.
constexpr char kTables[] = R"(
  CREATE TABLE tessera_version (version INTEGER NOT NULL);
  CREATE TABLE coordinator (one BOOLEAN PRIMARY KEY DEFAULT true CHECK (one), epoch BIGINT NOT NULL,
                            holder TEXT NOT NULL, renewed TIMESTAMPTZ NOT NULL);
  CREATE TABLE records (id BIGINT PRIMARY KEY, content BYTEA NOT NULL, xxh3 BIGINT NOT NULL,
                        job INTEGER NOT NULL DEFAULT -1);
  CREATE INDEX records_of_job ON records (job, id);
  CREATE TABLE deleted_jobs (job INTEGER PRIMARY KEY);
  CREATE TABLE removed (first BIGINT PRIMARY KEY, last BIGINT NOT NULL);
  CREATE TABLE set_aside (id BIGINT PRIMARY KEY, reason BYTEA NOT NULL);
  CREATE TABLE kept (name BYTEA PRIMARY KEY, value BYTEA NOT NULL);
  CREATE TABLE file_digests (path BYTEA PRIMARY KEY, size_bytes BIGINT NOT NULL, modified_ns BIGINT NOT NULL,
                             sha256 BYTEA NOT NULL);
  INSERT INTO coordinator (epoch, holder, renewed) VALUES (0, '', to_timestamp(0));
)";

// The first schema of the search_path, or where that is the user's own ("$user"), the one in which tables are made.
constexpr char kSelected[] = R"(
  WITH first AS (SELECT nullif(split_part(current_setting('search_path'), ',', 1), '') AS name),
       parsed AS (SELECT (parse_ident(trim(name)))[1] AS name FROM first)
  SELECT name, to_regnamespace(quote_ident(name)) IS NOT NULL FROM (
    SELECT CASE WHEN name = '$user' THEN current_schema() ELSE name END AS name FROM parsed) AS selected
)";

// The version of the schema's tables; 0: it has none. FAILED_PRECONDITION if others are there.
StatusOr<int64_t> ReadVersion(PostgresConnection& connection, const PostgresTarget& target) {
  const std::string schema = SqlText(target.schema);
  TESSERA_ASSIGN_OR_RETURN(
      const PostgresRows tables,
      connection.Run(absl::StrCat(
          "SELECT relname FROM pg_class c JOIN pg_namespace n ON n.oid = relnamespace WHERE nspname = ", schema,
          " AND relkind IN ('r', 'p', 'v', 'm', 'f') AND NOT EXISTS (SELECT 1 FROM pg_depend WHERE objid = c.oid AND "
          "deptype = 'e') ORDER BY relname <> 'tessera_version', relname")));
  if (tables.size() == 0) return 0;
  if (tables.Text(0, 0) != "tessera_version") {
    return absl::FailedPreconditionError(
        absl::StrCat(target.location, ": found the table ", Printable(tables.Text(0, 0)),
                     " of another program in schema ", Printable(target.schema),
                     ", expected a schema of tesserad; select another, which is created, by appending "
                     "?options=-csearch_path%3DNAME"));
  }
  TESSERA_ASSIGN_OR_RETURN(
      const PostgresRows rows,
      connection.Run(absl::StrCat("SELECT version FROM ", SqlName(target.schema), ".tessera_version")));
  return rows.size() > 0 ? rows.Int(0, 0) : 0;
}

// Sets the target's schema. Returns whether it exists.
StatusOr<bool> SelectSchema(PostgresConnection& connection, PostgresTarget& target) {
  TESSERA_ASSIGN_OR_RETURN(const PostgresRows selected, connection.Run(kSelected));
  if (selected.size() == 0 || selected.IsNull(0, 0)) {
    return absl::FailedPreconditionError(
        absl::StrCat(target.location, ": no schema is selected; append ?options=-csearch_path%3DNAME"));
  }
  target.schema = selected.Text(0, 0);
  if (target.schema != "public") absl::StrAppend(&target.location, " schema ", Printable(target.schema));
  return selected.Text(0, 1) == "t";
}

}  // namespace

StatusOr<bool> FindPostgresSchema(PostgresTarget& target) {
  TESSERA_ASSIGN_OR_RETURN(const auto connection, PostgresConnection::Open(target, kLimit_s));
  TESSERA_RETURN_IF_ERROR(SelectSchema(*connection, target).status());
  TESSERA_ASSIGN_OR_RETURN(const int64_t version, ReadVersion(*connection, target));
  return version > 0;
}

Status PreparePostgresSchema(PostgresTarget& target) {
  TESSERA_ASSIGN_OR_RETURN(const auto connection, PostgresConnection::Open(target, kLimit_s));
  TESSERA_ASSIGN_OR_RETURN(const bool exists, SelectSchema(*connection, target));
  TESSERA_ASSIGN_OR_RETURN(int64_t version, ReadVersion(*connection, target));
  if (version == 0) {
    const std::string name = SqlName(target.schema);
    const Status made = connection
                            ->Run(absl::StrCat(exists ? "" : absl::StrCat("CREATE SCHEMA ", name, ";"),
                                               "SET LOCAL search_path = ", name, ";", kTables,
                                               "INSERT INTO tessera_version VALUES (", kVersion, ")"))
                            .status();
    // Another process may have been faster.
    const StatusOr<int64_t> after = ReadVersion(*connection, target);
    if (!after.ok() || *after == 0) return made.ok() ? after.status() : made;
    version = *after;
  }
  if (version == kVersion) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrCat(target.location, ": schema version ", version, ", expected ",
                                                    kVersion, "; use the version of tesserad that wrote it"));
}

}  // namespace tessera
