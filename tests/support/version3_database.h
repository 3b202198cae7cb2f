// A coordinator's database as written by releases with schema version 3.
#pragma once

#include <gtest/gtest.h>
#include <sqlite3.h>

#include <memory>
#include <string>
#include <vector>

#include "common/storage/hash.h"
#include "server/store/sqlite_statement.h"

namespace tessera {

// Makes a file at `path` with these records, of a coordinator that was started six times.
inline void MakeVersion3Database(const std::string& path, const std::vector<std::string>& records) {
  sqlite3* opened = nullptr;
  ASSERT_EQ(sqlite3_open(path.c_str(), &opened), SQLITE_OK);
  const std::unique_ptr<sqlite3, int (*)(sqlite3*)> db(opened, sqlite3_close);
  // The text of that release.
  const Status made = RunSql(opened, path, R"(
    PRAGMA journal_mode=WAL;
    BEGIN IMMEDIATE; PRAGMA application_id=1415934835; PRAGMA user_version=3;
    CREATE TABLE records (id INTEGER PRIMARY KEY, content BLOB NOT NULL, xxh3 INTEGER NOT NULL);
    CREATE TABLE file_digests (path TEXT PRIMARY KEY, size_bytes INTEGER NOT NULL, modified_ns INTEGER NOT NULL,
                               sha256 TEXT NOT NULL) WITHOUT ROWID;
    CREATE TABLE starts (count INTEGER NOT NULL);
    INSERT INTO starts VALUES (0);
    COMMIT;
    CREATE TABLE IF NOT EXISTS set_aside (id INTEGER PRIMARY KEY, reason TEXT NOT NULL);
    UPDATE starts SET count = count + 6;
  )");
  ASSERT_TRUE(made.ok()) << made;
  for (const std::string& record : records) {
    Statement insert(opened, "INSERT INTO records (content, xxh3) VALUES (?, ?)");
    insert.BindBlob(1, record);
    insert.Bind(2, static_cast<int64_t>(Xxh3(record.data(), record.size())));
    ASSERT_EQ(insert.Step(), SQLITE_DONE);
  }
}

}  // namespace tessera
