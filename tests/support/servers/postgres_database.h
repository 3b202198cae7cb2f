// A schema of its own in the tests' PostgreSQL, for one test.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <memory>
#include <string>
#include <vector>

#include "server/store/postgres_connection.h"
#include "tests/support/servers/test_server.h"

namespace tessera {

// Runs SQL on the server and returns the first column of all rows as text; bytea as its bytes.
inline std::vector<std::string> RunPostgres(const std::string& url, const std::string& sql, bool bytes = false) {
  std::vector<std::string> column;
  const auto target = ParsePostgresUrl(url);
  EXPECT_TRUE(target.ok()) << target.status();
  if (!target.ok()) return column;
  const auto connection = PostgresConnection::Open(*target, 30);
  EXPECT_TRUE(connection.ok()) << connection.status();
  if (!connection.ok()) return column;
  const auto rows = (*connection)->Run(sql);
  EXPECT_TRUE(rows.ok()) << rows.status() << "\n" << sql;
  for (int row = 0; rows.ok() && row < rows->size(); ++row) {
    column.push_back(bytes ? rows->Bytes(row, 0) : rows->Text(row, 0));
  }
  return column;
}

// Dropped at the end. The schema does not exist before a store creates it.
class PostgresDatabase {
 public:
  // `server`: URL of a database without options.
  explicit PostgresDatabase(std::string server = ServerAddress("postgres")) : server_(std::move(server)) {
    static std::atomic<int> count = 0;
    schema_ = "test_" + std::to_string(::getpid()) + "_" + std::to_string(++count);
  }
  ~PostgresDatabase() { RunPostgres(server_, "DROP SCHEMA IF EXISTS " + schema_ + " CASCADE"); }
  PostgresDatabase(const PostgresDatabase&) = delete;
  PostgresDatabase& operator=(const PostgresDatabase&) = delete;

  const std::string& schema() const { return schema_; }
  std::string url() const { return UrlAt(server_); }
  // The same schema through another address of the server.
  std::string UrlAt(const std::string& server) const { return server + "?options=-csearch_path%3D" + schema_; }
  std::vector<std::string> Run(const std::string& sql, bool bytes = false) const {
    return RunPostgres(url(), sql, bytes);
  }

 private:
  const std::string server_;
  std::string schema_;
};

}  // namespace tessera
