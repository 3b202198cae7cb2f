// Tests of what every StateStore promises, on SQLite and on PostgreSQL.
#pragma once

#include <gtest/gtest.h>
#include <sqlite3.h>

#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "common/storage/files.h"
#include "server/store/state_store.h"
#include "tests/support/servers/postgres_database.h"

namespace tessera {

// All records, or what is wrong with them.
inline std::vector<std::string> AllRecords(RecordStore& store) {
  std::vector<std::string> records;
  const Status status = store.Replay([&](const StoredRecord& record) {
    records.push_back(record.content.ok() ? *record.content
                                          : std::to_string(record.number) + ": " + record.content.status().ToString());
  });
  EXPECT_TRUE(status.ok()) << status;
  return records;
}

// The first column of all rows, as text.
inline std::vector<std::string> RunSqlite(const std::string& path, const std::string& sql) {
  std::vector<std::string> column;
  sqlite3* db = nullptr;
  EXPECT_EQ(sqlite3_open(path.c_str(), &db), SQLITE_OK);
  const auto add = [](void* to, int, char** values, char**) {
    static_cast<std::vector<std::string>*>(to)->emplace_back(values[0]);
    return 0;
  };
  EXPECT_EQ(sqlite3_exec(db, sql.c_str(), add, &column, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
  sqlite3_close(db);
  return column;
}

// The parameter is the kind of database.
class StateTest : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    if (GetParam() == "Sqlite") return;
    TESSERA_NEED_SERVER("postgres");
    database_ = std::make_unique<PostgresDatabase>();
  }

  std::string Url() const { return database_ != nullptr ? database_->url() : folder_.path() + "/state.sqlite"; }
  std::unique_ptr<StateStore> Open(OwnerOf owner_of = {}) {
    auto store = OpenState(Url(), {.owner_of = std::move(owner_of), .holder = "test"});
    EXPECT_TRUE(store.ok()) << store.status();
    return store.ok() ? *std::move(store) : nullptr;
  }
  std::vector<std::string> Execute(const std::string& sql) {
    return database_ != nullptr ? database_->Run(sql) : RunSqlite(Url(), sql);
  }
  // Lets the lease of a process that was killed end at once.
  void ExpireLease() {
    if (database_ != nullptr) Execute("UPDATE coordinator SET renewed = to_timestamp(0)");
  }
  std::vector<int64_t> Select(const std::string& sql) {
    std::vector<int64_t> numbers;
    for (const std::string& text : Execute(sql)) numbers.push_back(std::strtoll(text.c_str(), nullptr, 10));
    return numbers;
  }

  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  std::unique_ptr<PostgresDatabase> database_;  // null: SQLite
};

inline std::string DatabaseName(const testing::TestParamInfo<std::string>& info) { return info.param; }
inline auto AllDatabases() { return testing::Values("Sqlite", "Postgres"); }

}  // namespace tessera
