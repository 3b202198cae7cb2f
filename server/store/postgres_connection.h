// Connections to PostgreSQL (libpq). Include in .cc files only.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "common/base/status.h"

struct pg_conn;
struct pg_result;

namespace tessera {

// What the last statement of a message returned. Movable.
class PostgresRows {
 public:
  explicit PostgresRows(pg_result* result);
  int size() const;
  bool IsNull(int row, int column) const;
  int64_t Int(int row, int column) const;
  double Real(int row, int column) const;
  std::string Text(int row, int column) const;
  // Of type bytea.
  std::string Bytes(int row, int column) const;

 private:
  std::unique_ptr<pg_result, void (*)(pg_result*)> result_;
};

// A database, and one of its schemas once that is known.
struct PostgresTarget {
  std::string url;       // may have a password: never in a message
  std::string location;  // for messages
  std::string schema;    // empty: as the URL and the server say
};

// A target without schema. INVALID_ARGUMENT if libpq cannot read the URL.
StatusOr<PostgresTarget> ParsePostgresUrl(const std::string& url);

// A session that commits each message by itself: there is never an open transaction between two calls of Run, unless
// the SQL begins one. Not thread-safe.
class PostgresConnection {
 public:
  // Connects to a host that accepts writes. `limit_s`: of each statement, at the server and here. UNAVAILABLE if none
  // can be reached; takes at most 2 s a host, or the URL's connect_timeout.
  static StatusOr<std::unique_ptr<PostgresConnection>> Open(const PostgresTarget& target, double limit_s);
  ~PostgresConnection();

  // Sends the SQL as one message and waits for its last result. The server executes nothing before it has the whole
  // message, and all of it in one transaction. After UNAVAILABLE it may or may not have been executed, and the
  // connection may be broken.
  StatusOr<PostgresRows> Run(const std::string& sql);
  // Must be opened anew.
  bool broken() const { return broken_; }
  // SQLSTATE of the last error that the server reported; empty if there was none.
  const std::string& error_code() const { return error_code_; }

 private:
  PostgresConnection(const PostgresTarget& target, double limit_s) : location_(target.location), limit_s_(limit_s) {}
  Status Await(int64_t until_us, bool write);
  Status Broken(const std::string& what);
  Status ServerError(const pg_result* result);

  const std::string location_;
  const double limit_s_;
  pg_conn* connection_ = nullptr;
  bool broken_ = false;
  std::string error_code_;
};

// Literals and names for SQL.
std::string SqlBytes(std::string_view bytes);  // of type bytea, for any bytes
std::string SqlText(std::string_view text);    // must be valid in the database's encoding
std::string SqlName(std::string_view name);
// The hexadecimal digits of bytes are appended.
void AppendHex(std::string& to, std::string_view bytes);

}  // namespace tessera
