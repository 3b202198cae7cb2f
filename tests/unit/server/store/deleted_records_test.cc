// Removal of records of deleted jobs, migration of the previous version, backups and salvage.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <cstdlib>
#include <random>

#include "common/storage/files.h"
#include "server/store/sqlite_salvage.h"
#include "server/store/sqlite_statement.h"
#include "server/store/sqlite_store.h"
#include "tests/support/version3_database.h"
#include "tests/unit/server/store/state_fixture.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// "2 text" is a record of job 2, "2 deleted" deletes it, and "text" is nobody's.
RecordOwner OwnerOfText(std::string_view record) {
  if (record.empty() || record[0] < '0' || record[0] > '9') return {};
  return {record[0] - '0', record.substr(1) == " deleted"};
}

class DeletedRecordsTest : public StateTest {
 protected:
  std::unique_ptr<StateStore> Open() { return StateTest::Open(OwnerOfText); }
  static void Append(StateStore& store, const std::string& record) {
    ASSERT_TRUE(store.Append({record}, Durability::kMachine).ok());
  }
};
INSTANTIATE_TEST_SUITE_P(Databases, DeletedRecordsTest, AllDatabases(), DatabaseName);

TEST_P(DeletedRecordsTest, DeletedRecordsAreSkippedAndRemovedInSteps) {
  {
    auto store = Open();
    for (const char* record : {"1 a", "2 a", "text", "1 b", "2 b", "1 c", "1 deleted", "2 c"}) Append(*store, record);
  }
  const auto kept = ElementsAre("2 a", "text", "2 b", "1 deleted", "2 c");
  EXPECT_THAT(AllRecords(*Open()), kept);
  for (const int removed : {2, 1, 0}) {  // each by a process of its own
    auto store = Open();
    EXPECT_EQ(*store->RemoveRecords(2), removed);
    EXPECT_THAT(AllRecords(*store), kept) << "nothing that was removed is taken for lost";
  }
  EXPECT_THAT(*Open()->DeletedJobs(), ElementsAre(1));
  EXPECT_THAT(Select("SELECT id FROM records ORDER BY id"), ElementsAre(2, 3, 5, 7, 8));
  // Loss beside what was removed is still found.
  Select("DELETE FROM records WHERE id = 5");
  EXPECT_THAT(AllRecords(*Open()),
              ElementsAre("2 a", "text", HasSubstr("5: DATA_LOSS: record missing"), "1 deleted", "2 c"));
}

TEST_P(DeletedRecordsTest, RecordNumbersAreNeverReused) {
  {
    auto store = Open();
    for (const char* record : {"1 a", "1 deleted", "1 late", "1 later"}) Append(*store, record);
    EXPECT_EQ(*store->RemoveRecords(10), 3);
  }
  Append(*Open(), "2 a");
  EXPECT_THAT(Select("SELECT id FROM records ORDER BY id"), ElementsAre(2, 5));
  EXPECT_THAT(AllRecords(*Open()), ElementsAre("1 deleted", "2 a"));
}

// Whatever is deleted in whatever order and steps, what is visited is just what is kept, and the ranges of removed
// numbers are as few as can be.
TEST_P(DeletedRecordsTest, OtherRecordsAreKept) {
  std::mt19937 random(1);
  auto store = Open();
  std::vector<std::string> records;
  std::set<char> deleted;
  for (int i = 0; i < 400; ++i) {
    const char job = static_cast<char>('1' + random() % 8);
    const bool deletes = random() % 60 == 0;
    std::string record = deletes ? "x deleted" : "x " + std::to_string(i);
    record[0] = job;
    Append(*store, record);
    records.push_back(record);
    if (deletes) deleted.insert(job);
    if (random() % 4 == 0) {
      ASSERT_TRUE(store->RemoveRecords(1 + static_cast<int>(random() % 7)).ok());
    }
    if (random() % 50 == 0) store = (store.reset(), Open());
  }
  ASSERT_GT(deleted.size(), 2u);
  ASSERT_LT(deleted.size(), 8u);
  std::erase_if(records, [&](const std::string& record) {
    return deleted.contains(record[0]) && record.substr(1) != " deleted";
  });
  EXPECT_EQ(AllRecords(*store), records);
  while (*store->RemoveRecords(7) > 0) {
  }
  EXPECT_EQ(AllRecords(*store), records);
  EXPECT_THAT(Select("SELECT count(*) FROM records"), ElementsAre(static_cast<int64_t>(records.size())));
  EXPECT_THAT(Select("SELECT a.first FROM removed a JOIN removed b ON a.last + 1 >= b.first AND a.first < b.first"),
              IsEmpty());
}

class SqliteFileTest : public testing::Test {
 protected:
  std::unique_ptr<SqliteStore> Open() {
    auto store = SqliteStore::Open(path_, OwnerOfText);
    EXPECT_TRUE(store.ok()) << store.status();
    return store.ok() ? *std::move(store) : nullptr;
  }
  static void Append(StateStore& store, const std::string& record) {
    ASSERT_TRUE(store.Append({record}, Durability::kMachine).ok());
  }
  // The first column of all rows.
  static std::vector<int64_t> Select(const std::string& sql, const std::string& path) {
    std::vector<int64_t> numbers;
    for (const std::string& text : RunSqlite(path, sql)) numbers.push_back(std::strtoll(text.c_str(), nullptr, 10));
    return numbers;
  }

  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  const std::string path_ = folder_.path() + "/state.sqlite";
};

TEST_F(SqliteFileTest, PreviousVersionIsMigratedAndCopied) {
  MakeVersion3Database(path_, {"1 a", "text", "2 a"});
  {
    auto store = Open();
    EXPECT_EQ(store->StartCount(), 7);
    EXPECT_THAT(AllRecords(*store), ElementsAre("1 a", "text", "2 a"));
    Append(*store, "1 deleted");
    EXPECT_THAT(*store->RemoveRecords(10), 1);
  }
  EXPECT_THAT(AllRecords(*Open()), ElementsAre("text", "2 a", "1 deleted"));
  EXPECT_THAT(Select("PRAGMA user_version", path_), ElementsAre(4));
  const std::string copy = path_ + ".v3";
  EXPECT_THAT(Select("PRAGMA user_version", copy), ElementsAre(3));
  EXPECT_THAT(Select("SELECT id FROM records", copy), ElementsAre(1, 2, 3));
  EXPECT_THAT(Select("SELECT count FROM starts", copy), ElementsAre(6));
  EXPECT_FALSE(FileExists(copy + "-wal"));
}

// A migration that fails half way leaves all as it was.
TEST_F(SqliteFileTest, MigrationIsAtomic) {
  { Append(*Open(), "1 a"); }
  // As of version 3, but with a table in the way that only the last step makes.
  Select(
      "DROP INDEX records_of_job; DROP TABLE deleted_jobs; ALTER TABLE records DROP COLUMN job;"
      "PRAGMA user_version = 3",
      path_);
  EXPECT_FALSE(SqliteStore::Open(path_, OwnerOfText).ok()) << "removed is there already";
  EXPECT_THAT(Select("PRAGMA user_version", path_), ElementsAre(3));
  Select("DROP TABLE removed", path_);
  EXPECT_THAT(AllRecords(*Open()), ElementsAre("1 a"));
}

TEST_F(SqliteFileTest, BackupIsASnapshotWithUniqueStartCounts) {
  const std::string backup = folder_.path() + "/backup";
  auto store = Open();
  Append(*store, "1 a");
  ASSERT_TRUE(BackUp(path_, backup).ok()) << "in use";
  Append(*store, "1 b");
  const int64_t starts = store->StartCount();
  store.reset();
  ASSERT_TRUE(RemoveTree(path_).ok());
  ASSERT_TRUE(CopyFileDurably(backup, path_).ok());
  store = Open();
  EXPECT_THAT(AllRecords(*store), ElementsAre("1 a"));
  EXPECT_GT(store->StartCount(), starts + 1'000'000);
  Append(*store, "1 c");
  EXPECT_THAT(AllRecords(*store), ElementsAre("1 a", "1 c"));
  EXPECT_FALSE(BackUp(folder_.path() + "/none", backup).ok());
  EXPECT_THAT(Select("SELECT id FROM records", backup), ElementsAre(1)) << "a copy that failed replaces none";
}

// Pages in the middle of the file are overwritten: what lies on others is kept.
TEST_F(SqliteFileTest, ReadableRecordsOfDamagedFileAreSalvaged) {
  constexpr int kRecords = 3000;
  int64_t starts = 0;
  {
    auto store = Open();
    const std::string other(200, 'x');
    std::vector<std::string_view> records;
    for (int i = 1; i <= kRecords; ++i) records.push_back(i % 3 == 0 ? std::string_view("1 a") : other);
    records.push_back("1 deleted");
    ASSERT_TRUE(store->Append(records, Durability::kMachine).ok());
    ASSERT_TRUE(store->RemoveRecords(50).ok());  // so few that their numbers lie on no damaged page
    starts = store->StartCount();
  }
  std::string bytes = *ReadFile(path_);
  const size_t page = 4096;
  for (const size_t damaged : {bytes.size() / page / 4, bytes.size() / page / 2}) {
    bytes.replace(damaged * page, 2 * page, std::string(2 * page, '\xab'));
  }
  ASSERT_TRUE(WriteFileAtomic(path_, bytes).ok());
  const auto refused = SqliteStore::Open(path_, OwnerOfText);
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(refused.status().message()), HasSubstr("tesserad --salvage"));
  const auto salvaged = Salvage(path_, OwnerOfText);
  ASSERT_TRUE(salvaged.ok()) << salvaged.status();
  EXPECT_EQ(*ReadFile(salvaged->damaged), bytes) << "the damaged file is kept";
  EXPECT_EQ(salvaged->last, kRecords + 1);
  int readable = 0;
  sqlite3* damaged = nullptr;
  ASSERT_EQ(sqlite3_open(salvaged->damaged.c_str(), &damaged), SQLITE_OK);
  for (int id = 1; id <= kRecords + 1; ++id) {
    Statement one(damaged, "SELECT content FROM records WHERE id = ?");
    one.Bind(1, id);
    readable += one.Step() == SQLITE_ROW;
  }
  sqlite3_close(damaged);
  EXPECT_LT(readable, kRecords - 50);
  EXPECT_EQ(salvaged->records, readable) << "none that can be read is left behind";
  auto store = Open();
  EXPECT_GT(store->StartCount(), starts);
  EXPECT_THAT(*store->DeletedJobs(), ElementsAre(1));
  int usable = 0, faults = 0;
  EXPECT_TRUE(store->Replay([&](const StoredRecord& record) { ++(record.content.ok() ? usable : faults); }).ok());
  EXPECT_GT(faults, 0) << "what is missing is told";
  EXPECT_LT(faults, 10) << "and what was removed is not taken for missing";
  EXPECT_GT(usable, 2000 - 150);
}

}  // namespace
}  // namespace tessera
