// What every StateStore promises.
#include "server/store/state_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <string>
#include <vector>

#include "tests/unit/server/store/state_fixture.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class StateStoreTest : public StateTest {};
INSTANTIATE_TEST_SUITE_P(Databases, StateStoreTest, AllDatabases(), DatabaseName);

TEST_P(StateStoreTest, KeepsRecordsInOrderAndCountsStarts) {
  const std::string binary("a\0b\x80\\\"'", 7);
  int64_t starts = 0;
  {
    auto store = Open();
    starts = store->StartCount();
    EXPECT_TRUE(store->Append({"one"}, Durability::kMachine).ok());
    EXPECT_TRUE(store->Append({binary}, Durability::kMachine).ok());
    EXPECT_TRUE(store->Append({""}, Durability::kProcess).ok());
  }
  auto store = Open();
  EXPECT_GT(store->StartCount(), starts);
  EXPECT_THAT(AllRecords(*store), ElementsAre("one", binary, ""));
}

TEST_P(StateStoreTest, QuarantinedRecordsAreKeptButNotVisited) {
  {
    auto store = Open();
    for (const char* record : {"one", "two", "three"}) ASSERT_TRUE(store->Append({record}, Durability::kMachine).ok());
    ASSERT_TRUE(store->Quarantine(2, "does not fit").ok());
    ASSERT_TRUE(store->Quarantine(2, "still not").ok());
  }
  EXPECT_THAT(AllRecords(*Open()), ElementsAre("one", "three"));
  Execute("DELETE FROM set_aside");
  EXPECT_THAT(AllRecords(*Open()), ElementsAre("one", "two", "three"));
}

// A process that dies without closing the store loses nothing that was acknowledged.
TEST_P(StateStoreTest, SurvivesAKilledProcess) {
  int acknowledged[2];
  ASSERT_EQ(pipe(acknowledged), 0);
  const pid_t child = fork();
  if (child == 0) {
    auto store = OpenState(Url(), {});
    for (int i = 0; i < 20; ++i) {
      const std::string record = "record " + std::to_string(i);
      const auto durability = i % 2 == 0 ? Durability::kMachine : Durability::kProcess;
      if (!store.ok() || !(*store)->Append({record}, durability).ok()) _exit(1);
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
  ExpireLease();
  const auto records = AllRecords(*Open());
  ASSERT_EQ(records.size(), 20u);
  EXPECT_EQ(records[19], "record 19");
}

TEST_P(StateStoreTest, ValuesAreKept) {
  std::string key;
  {
    auto store = Open();
    key = *store->WorkerKey();
    EXPECT_GE(key.size(), 40u);
    EXPECT_EQ(*store->WorkerKey(), key);
    EXPECT_EQ(*store->Keep("blobs", std::string("/a\0\xff", 4)), std::string("/a\0\xff", 4));
  }
  auto store = Open();
  EXPECT_EQ(*store->WorkerKey(), key);
  EXPECT_EQ(*store->Keep("blobs", "/b"), std::string("/a\0\xff", 4));
  EXPECT_EQ(*store->Keep("roots", ""), "");
}

// While a store is open, no second one can be opened. Release lets the next one in at once.
TEST_P(StateStoreTest, OneStoreAtATime) {
  auto store = Open();
  EXPECT_GT(store->HeldFor_s(), 0);
  const auto second = OpenState(Url(), {.holder = "second"});
  EXPECT_EQ(second.status().code(), absl::StatusCode::kFailedPrecondition) << second.status();
  ASSERT_TRUE(store->Append({"one"}, Durability::kMachine).ok());
  store->Release();
  EXPECT_LE(store->HeldFor_s(), 0);
  auto next = Open();
  ASSERT_NE(next, nullptr);
  EXPECT_TRUE(IsTakenOver(store->Append({"two"}, Durability::kMachine)));
  EXPECT_TRUE(IsTakenOver(store->Quarantine(1, "")));
  EXPECT_TRUE(IsTakenOver(store->RemoveRecords(1).status()));
  EXPECT_TRUE(IsTakenOver(store->Remember("/x", {7, 1}, {std::string(64, 'a'), 7})));
  EXPECT_TRUE(IsTakenOver(store->Keep("name", "value").status()));
  EXPECT_THAT(AllRecords(*next), ElementsAre("one"));
}

TEST_P(StateStoreTest, LargeBatchesAreStored) {
  std::vector<std::string> records;
  for (int i = 0; i < 9000; ++i) records.push_back(std::to_string(i) + std::string(i % 700, static_cast<char>(i)));
  {
    auto store = Open();
    ASSERT_TRUE(store->Append({records.begin(), records.begin() + 5000}, Durability::kProcess).ok());
    ASSERT_TRUE(store->Append({records.begin() + 5000, records.end()}, Durability::kMachine).ok());
    ASSERT_TRUE(store->Append({}, Durability::kMachine).ok());
  }
  EXPECT_EQ(AllRecords(*Open()), records);
}

TEST_P(StateStoreTest, DamagedRecordsAreReportedAndOthersVisited) {
  {
    auto store = Open();
    for (const char* record : {"one", "two", "three", "four"}) {
      ASSERT_TRUE(store->Append({record}, Durability::kMachine).ok());
    }
  }
  Execute("UPDATE records SET content = 'owt' WHERE id = 2");
  EXPECT_THAT(AllRecords(*Open()),
              ElementsAre("one", HasSubstr("2: DATA_LOSS: row 2 of table records is damaged"), "three", "four"));
  Execute("DELETE FROM records WHERE id IN (1, 2)");
  EXPECT_THAT(AllRecords(*Open()),
              ElementsAre(HasSubstr("1: DATA_LOSS: record missing, as are all before 3"), "three", "four"));
  ASSERT_TRUE(Open()->Quarantine(1, "missing").ok());
  EXPECT_THAT(AllRecords(*Open()), ElementsAre("three", "four"));
}

TEST_P(StateStoreTest, DigestIsCachedWhileTheStampIsUnchanged) {
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
