#include "server/store/sqlite_schema.h"

#include <sqlite3.h>

#include <memory>
#include <utility>

#include "common/storage/files.h"
#include "common/storage/temporary_name.h"
#include "server/store/sqlite_statement.h"

namespace tessera {
namespace {

constexpr int kApplicationId = 0x54657373;  // "Tess"
constexpr int kSchemaVersion = 4;           // of the tables, and of the records in them
constexpr int kOldestVersion = 3;           // oldest version that can be migrated
constexpr int kCopiedPages = 1024;          // per copy step, 4 KiB each

// `job`: owner of the record; -1: no job.
constexpr char kSchema[] = R"(
  CREATE TABLE records (id INTEGER PRIMARY KEY, content BLOB NOT NULL, xxh3 INTEGER NOT NULL,
                        job INTEGER NOT NULL DEFAULT -1);
  CREATE TABLE file_digests (path TEXT PRIMARY KEY, size_bytes INTEGER NOT NULL, modified_ns INTEGER NOT NULL,
                             sha256 TEXT NOT NULL) WITHOUT ROWID;
  CREATE TABLE starts (count INTEGER NOT NULL);
  INSERT INTO starts VALUES (0);
)";
// Added by version 4: numbers of removed records, as ranges that do not touch.
constexpr char kSince4[] = R"(
  CREATE INDEX records_of_job ON records (job);
  CREATE TABLE deleted_jobs (job INTEGER PRIMARY KEY);
  CREATE TABLE removed (first INTEGER PRIMARY KEY, last INTEGER NOT NULL);
)";
// Quarantined records, and values by name. Present in every version: earlier releases can read the file.
constexpr char kInEveryVersion[] = R"(
  CREATE TABLE IF NOT EXISTS set_aside (id INTEGER PRIMARY KEY, reason TEXT NOT NULL);
  CREATE TABLE IF NOT EXISTS kept (name TEXT PRIMARY KEY, value BLOB NOT NULL) WITHOUT ROWID;
)";

std::string SetVersion() { return "PRAGMA user_version=" + std::to_string(kSchemaVersion) + ";"; }

// The SQL function job_of(content).
void JobOf(sqlite3_context* context, int, sqlite3_value** values) {
  const auto& owner_of = *static_cast<const OwnerOf*>(sqlite3_user_data(context));
  const auto* const data = static_cast<const char*>(sqlite3_value_blob(values[0]));
  const auto size = static_cast<size_t>(sqlite3_value_bytes(values[0]));
  sqlite3_result_int64(context, owner_of && data != nullptr ? owner_of({data, size}).job : -1);
}

Status Migrate(sqlite3* db, const std::string& path, int64_t version, const OwnerOf& owner_of) {
  TESSERA_RETURN_IF_ERROR(CopyDatabase(db, path, path + ".v" + std::to_string(version)));
  OwnerOf owner = owner_of;
  const int code = sqlite3_create_function(db, "job_of", 1, SQLITE_UTF8, &owner, JobOf, nullptr, nullptr);
  if (code != SQLITE_OK) return SqliteError(path, db, code, "cannot migrate");
  TESSERA_RETURN_IF_ERROR(RunSql(db, path, "BEGIN IMMEDIATE"));
  Status status = RunSql(db, path, "ALTER TABLE records ADD COLUMN job INTEGER NOT NULL DEFAULT -1");
  if (status.ok()) status = RunSql(db, path, "UPDATE records SET job = job_of(content)");
  if (status.ok()) status = RunSql(db, path, kSince4 + SetVersion() + "COMMIT;");
  if (!status.ok() && sqlite3_get_autocommit(db) == 0) RunSql(db, path, "ROLLBACK").IgnoreError();
  sqlite3_create_function(db, "job_of", 1, SQLITE_UTF8, nullptr, nullptr, nullptr, nullptr);
  return status;
}

// DATA_LOSS with the result of SQLite's integrity check, and what to do.
Status CheckIntegrity(sqlite3* db, const std::string& path) {
  Statement check(db, "PRAGMA quick_check(1)");
  const int step = check.Step();
  if (step != SQLITE_ROW) return SqliteError(path, db, step, "integrity check");
  if (const std::string found = check.Bytes(0); found != "ok") {
    return absl::DataLossError(path + " is damaged: " + found +
                               "; restore a backup, or recover the readable records with tesserad --salvage");
  }
  return absl::OkStatus();
}

}  // namespace

Status PrepareSchema(sqlite3* db, const std::string& path, const OwnerOf& owner_of) {
  TESSERA_ASSIGN_OR_RETURN(const int64_t application, ReadNumber(db, path, "PRAGMA application_id"));
  TESSERA_ASSIGN_OR_RETURN(const int64_t version, ReadNumber(db, path, "PRAGMA user_version"));
  TESSERA_ASSIGN_OR_RETURN(const int64_t tables, ReadNumber(db, path, "SELECT count(*) FROM sqlite_master"));
  if (tables > 0 && application != kApplicationId) {
    return absl::FailedPreconditionError(path + ": found a database of another program, expected one of tesserad");
  }
  if (tables > 0 && (version < kOldestVersion || version > kSchemaVersion)) {
    return absl::FailedPreconditionError(path + ": schema version " + std::to_string(version) + ", expected " +
                                         std::to_string(kSchemaVersion) +
                                         "; use the version of tesserad that wrote it, or another --data folder");
  }
  TESSERA_RETURN_IF_ERROR(RunSql(db, path, "PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL"));
  if (tables == 0) {
    TESSERA_RETURN_IF_ERROR(RunSql(db, path,
                                   "BEGIN IMMEDIATE; PRAGMA application_id=" + std::to_string(kApplicationId) + ";" +
                                       SetVersion() + kSchema + kSince4 + "COMMIT;"));
  }
  TESSERA_RETURN_IF_ERROR(CheckIntegrity(db, path));
  if (tables > 0 && version < kSchemaVersion) TESSERA_RETURN_IF_ERROR(Migrate(db, path, version, owner_of));
  return RunSql(db, path, kInEveryVersion);
}

Status CopyDatabase(sqlite3* db, const std::string& path, const std::string& to, const std::string& change) {
  const std::string temporary = TemporaryBeside(to);
  sqlite3* opened = nullptr;
  int code = sqlite3_open_v2(temporary.c_str(), &opened, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, nullptr);
  Database copy(opened, sqlite3_close_v2);
  Status status = code == SQLITE_OK ? absl::OkStatus() : SqliteError(to, opened, code, "cannot create a copy");
  // Hold one read transaction for all steps: without it, every concurrent write restarts the copy.
  if (status.ok()) status = RunSql(db, path, "BEGIN; SELECT count(*) FROM sqlite_master");
  if (status.ok()) {
    sqlite3_backup* const backup = sqlite3_backup_init(opened, "main", db, "main");
    do {
      code = backup != nullptr ? sqlite3_backup_step(backup, kCopiedPages) : SQLITE_ERROR;
    } while (code == SQLITE_OK);
    sqlite3_backup_finish(backup);
    if (code != SQLITE_DONE) status = SqliteError(to, opened, code, "cannot copy " + path);
    const Status ended = RunSql(db, path, "COMMIT");
    if (status.ok()) status = ended;
  }
  // Leave no write-ahead log beside the copy.
  if (status.ok()) status = RunSql(opened, to, "PRAGMA journal_mode=DELETE;" + change);
  if (status.ok()) status = CheckIntegrity(opened, to);
  copy.reset();
  if (status.ok()) status = SyncPath(temporary);
  if (status.ok()) status = RenameDurably(temporary, to);
  if (!status.ok()) RemoveTree(temporary).IgnoreError();
  return status;
}

}  // namespace tessera
