#include "server/store/sqlite_statement.h"

#include <sqlite3.h>

namespace tessera {

Status SqliteError(const std::string& path, sqlite3* db, int code, const std::string& what) {
  const std::string message = path + ": " + what + ": " + (db != nullptr ? sqlite3_errmsg(db) : sqlite3_errstr(code));
  switch (code & 0xff) {
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return absl::DataLossError(message);
    case SQLITE_FULL:
    case SQLITE_NOMEM:
      return absl::ResourceExhaustedError(message);
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return absl::FailedPreconditionError(message);
    default:
      return absl::InternalError(message);
  }
}

StatusOr<Database> OpenDatabase(const std::string& path, int flags) {
  sqlite3* opened = nullptr;
  const int code = sqlite3_open_v2(path.c_str(), &opened, flags, nullptr);
  Database db(opened, sqlite3_close_v2);
  if (code != SQLITE_OK) return SqliteError(path, opened, code, "cannot open");
  sqlite3_busy_timeout(opened, 2000);
  return db;
}

Status RunSql(sqlite3* db, const std::string& path, const std::string& sql) {
  const int code = sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr);
  return code == SQLITE_OK ? absl::OkStatus() : SqliteError(path, db, code, sql.substr(0, 60));
}

StatusOr<int64_t> ReadNumber(sqlite3* db, const std::string& path, const char* sql) {
  Statement statement(db, sql);
  const int code = statement.Step();
  if (code != SQLITE_ROW) return SqliteError(path, db, code, sql);
  return statement.Int(0);
}

Statement::Statement(sqlite3* db, const char* sql) { code_ = sqlite3_prepare_v2(db, sql, -1, &statement_, nullptr); }

Statement::~Statement() { sqlite3_finalize(statement_); }

void Statement::Bind(int index, int64_t value) { Keep(sqlite3_bind_int64(statement_, index, value)); }

void Statement::BindText(int index, const std::string& value) {
  Keep(sqlite3_bind_text(statement_, index, value.data(), static_cast<int>(value.size()), SQLITE_TRANSIENT));
}

void Statement::BindBlob(int index, std::string_view value) {
  // SQLite binds NULL for a null pointer, so pass "" for an empty value.
  Keep(sqlite3_bind_blob64(statement_, index, value.empty() ? "" : value.data(), value.size(), SQLITE_STATIC));
}

int Statement::Step() { return code_ == SQLITE_OK ? sqlite3_step(statement_) : code_; }

void Statement::Reset() {
  if (statement_ == nullptr) return;
  sqlite3_reset(statement_);
  sqlite3_clear_bindings(statement_);
  code_ = SQLITE_OK;
}

int64_t Statement::Int(int column) { return sqlite3_column_int64(statement_, column); }

std::string Statement::Bytes(int column) {
  const auto* data = static_cast<const char*>(sqlite3_column_blob(statement_, column));
  return data == nullptr ? std::string()
                         : std::string(data, static_cast<size_t>(sqlite3_column_bytes(statement_, column)));
}

void Statement::Keep(int code) {
  if (code_ == SQLITE_OK) code_ = code;
}

}  // namespace tessera
