#include "server/store/sqlite_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sqlite3.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <vector>

#include "common/storage/files.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

std::vector<std::string> All(SqliteStore& store) {
  std::vector<std::string> records;
  const Status status = store.Replay([&](const StoredRecord& record) {
    records.push_back(record.content.ok() ? *record.content
                                          : std::to_string(record.number) + ": " + record.content.status().ToString());
  });
  EXPECT_TRUE(status.ok()) << status;
  return records;
}

class SqliteStoreTest : public testing::Test {
 protected:
  std::unique_ptr<SqliteStore> Open() {
    auto store = SqliteStore::Open(path_);
    EXPECT_TRUE(store.ok()) << store.status();
    return *std::move(store);
  }
  void Execute(const std::string& sql) {
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(path_.c_str(), &db), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
    sqlite3_close(db);
  }

  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  const std::string path_ = folder_.path() + "/state.sqlite";
};

TEST_F(SqliteStoreTest, KeepsRecordsInOrderAndCountsStarts) {
  const std::string binary("a\0b", 3);
  {
    auto store = Open();
    EXPECT_EQ(store->StartCount(), 1);
    EXPECT_TRUE(store->Append({"one"}, Durability::kMachine).ok());
    EXPECT_TRUE(store->Append({binary}, Durability::kMachine).ok());
    EXPECT_TRUE(store->Append({""}, Durability::kProcess).ok());
  }
  auto store = Open();
  EXPECT_EQ(store->StartCount(), 2);
  EXPECT_THAT(All(*store), ElementsAre("one", binary, ""));
}

TEST_F(SqliteStoreTest, QuarantinedRecordsAreKeptButNotVisited) {
  {
    auto store = Open();
    for (const char* record : {"one", "two", "three"}) ASSERT_TRUE(store->Append({record}, Durability::kMachine).ok());
    ASSERT_TRUE(store->Quarantine(2, "does not fit").ok());
    ASSERT_TRUE(store->Quarantine(2, "still not").ok());
  }
  EXPECT_THAT(All(*Open()), ElementsAre("one", "three"));
  Execute("DELETE FROM set_aside");
  EXPECT_THAT(All(*Open()), ElementsAre("one", "two", "three"));
}

// A process that dies without closing the store loses nothing that was acknowledged.
TEST_F(SqliteStoreTest, SurvivesAKilledProcess) {
  int acknowledged[2];
  ASSERT_EQ(pipe(acknowledged), 0);
  const pid_t child = fork();
  if (child == 0) {
    auto store = SqliteStore::Open(path_);
    for (int i = 0; i < 20; ++i) {
      if (!store.ok() ||
          !(*store)
               ->Append({"record " + std::to_string(i)}, i % 2 == 0 ? Durability::kMachine : Durability::kProcess)
               .ok())
        _exit(1);
    }
    (void)!write(acknowledged[1], "k", 1);
    raise(SIGKILL);  // no destructor, no checkpoint of the log
  }
  char byte = 0;
  close(acknowledged[1]);
  ASSERT_EQ(read(acknowledged[0], &byte, 1), 1);
  int wait_status = 0;
  waitpid(child, &wait_status, 0);
  ASSERT_TRUE(WIFSIGNALED(wait_status));
  EXPECT_TRUE(FileExists(path_ + "-wal"));
  const auto records = All(*Open());
  ASSERT_EQ(records.size(), 20u);
  EXPECT_EQ(records[19], "record 19");
}

TEST_F(SqliteStoreTest, DamagedRecordsAreReportedAndOthersVisited) {
  {
    auto store = Open();
    for (const char* record : {"one", "two", "three", "four"}) {
      ASSERT_TRUE(store->Append({record}, Durability::kMachine).ok());
    }
  }
  Execute("UPDATE records SET content = 'owt' WHERE id = 2");
  EXPECT_THAT(All(*Open()),
              ElementsAre("one", HasSubstr("2: DATA_LOSS: row 2 of table records is damaged"), "three", "four"));
  Execute("DELETE FROM records WHERE id IN (1, 2)");
  EXPECT_THAT(All(*Open()),
              ElementsAre(HasSubstr("1: DATA_LOSS: record missing, as are all before 3"), "three", "four"));
  ASSERT_TRUE(Open()->Quarantine(1, "missing").ok());
  EXPECT_THAT(All(*Open()), ElementsAre("three", "four"));
}

TEST_F(SqliteStoreTest, RefusesOtherDatabases) {
  std::ofstream(path_) << std::string(5000, 'x');
  EXPECT_EQ(SqliteStore::Open(path_).status().code(), absl::StatusCode::kDataLoss);
  ASSERT_TRUE(RemoveTree(path_).ok());
  Execute("CREATE TABLE other (x)");
  EXPECT_EQ(SqliteStore::Open(path_).status().code(), absl::StatusCode::kFailedPrecondition);
  ASSERT_TRUE(RemoveTree(path_).ok());
  { Open(); }
  for (const std::string version : {"2", "99"}) {
    Execute("PRAGMA user_version = " + version);
    const auto other = SqliteStore::Open(path_);
    EXPECT_THAT(std::string(other.status().message()), HasSubstr("schema version " + version + ", expected"));
  }
  EXPECT_FALSE(SqliteStore::Open(folder_.path() + "/none/x").ok());
}

TEST_F(SqliteStoreTest, DigestIsCachedWhileTheStampIsUnchanged) {
  auto store = Open();
  const Digest digest{std::string(64, 'a'), 7};
  EXPECT_FALSE(store->Find("/x", {7, 1}).has_value());
  ASSERT_TRUE(store->Remember("/x", {7, 1}, digest).ok());
  EXPECT_EQ(store->Find("/x", {7, 1}), digest);
  EXPECT_FALSE(store->Find("/x", {7, 2}).has_value());
  EXPECT_FALSE(store->Find("/x", {8, 1}).has_value());
  ASSERT_TRUE(store->Remember("/x", {8, 2}, {std::string(64, 'b'), 8}).ok());
  EXPECT_FALSE(store->Find("/x", {7, 1}).has_value());
}

}  // namespace
}  // namespace tessera
