// Wrappers of SQLite's C interface for this folder. Include in .cc files only.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "common/base/status.h"

struct sqlite3;
struct sqlite3_stmt;

namespace tessera {

// DATA_LOSS if the file is damaged or no database, RESOURCE_EXHAUSTED if the disk is full, FAILED_PRECONDITION if the
// file is locked, else INTERNAL; with SQLite's message. `db` may be null.
Status SqliteError(const std::string& path, sqlite3* db, int code, const std::string& what);

// An open connection, closed on destruction.
using Database = std::unique_ptr<sqlite3, int (*)(sqlite3*)>;
// `flags`: of sqlite3_open_v2. Waits up to 2 s for a locked file.
StatusOr<Database> OpenDatabase(const std::string& path, int flags);

// Runs statements without results.
Status RunSql(sqlite3* db, const std::string& path, const std::string& sql);

// The first column of the first row.
StatusOr<int64_t> ReadNumber(sqlite3* db, const std::string& path, const char* sql);

// A prepared statement with RAII. Errors of binding are returned by Step. Not thread-safe.
class Statement {
 public:
  Statement(sqlite3* db, const char* sql);
  ~Statement();
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  void Bind(int index, int64_t value);
  void BindText(int index, const std::string& value);
  // `value` must live until the next Reset.
  void BindBlob(int index, std::string_view value);
  // SQLITE_ROW, SQLITE_DONE or an error.
  int Step();
  // Prepares the statement for new values; releases the bound ones.
  void Reset();
  int64_t Int(int column);
  std::string Bytes(int column);

 private:
  void Keep(int code);
  sqlite3_stmt* statement_ = nullptr;
  int code_ = 0;
};

}  // namespace tessera
