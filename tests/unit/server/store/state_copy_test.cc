// A state is copied between databases whole or not at all.
#include "server/store/state_copy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "tests/unit/server/store/state_fixture.h"

namespace tessera {
namespace {

using testing::IsEmpty;
using testing::SizeIs;

// The parameter is the database of the copy; the original is in the other one.
class StateCopyTest : public StateTest {
 protected:
  void SetUp() override {
    TESSERA_NEED_SERVER("postgres");
    StateTest::SetUp();
    if (database_ == nullptr) original_database_ = std::make_unique<PostgresDatabase>();
    original_ = *OpenState(original_database_ != nullptr ? original_database_->url() : folder_.path() + "/original",
                           {.owner_of = OwnerOfDigit, .holder = "original"});
  }
  // "2 text" is of job 2; "2" deletes it.
  static RecordOwner OwnerOfDigit(std::string_view record) {
    if (record.empty() || record[0] < '0' || record[0] > '9') return {};
    return {record[0] - '0', record.size() == 1};
  }
  static std::vector<std::string> Rows(StateStore& store) {
    std::vector<std::string> rows;
    EXPECT_TRUE(store
                    .Export([&](const StateTable& table, const StateRow& row) {
                      rows.emplace_back(table.name);
                      for (const std::string& value : row) rows.back() += "|" + value;
                      return absl::OkStatus();
                    })
                    .ok());
    return rows;
  }

  std::unique_ptr<PostgresDatabase> original_database_;
  std::unique_ptr<StateStore> original_;
};
INSTANTIATE_TEST_SUITE_P(Databases, StateCopyTest, AllDatabases(), DatabaseName);

TEST_P(StateCopyTest, EverythingIsCopied) {
  const std::string binary("\0'\\\"\x80\xff,()", 9);
  std::vector<std::string> records = {"1 a", "2 a", binary, "", "1 b", "1", "2 b", std::string(1 << 20, 'x')};
  for (int i = 0; i < 9000; ++i) records.push_back("2 record " + std::to_string(i));
  ASSERT_TRUE(original_->Append({records.begin(), records.end()}, Durability::kMachine).ok());
  ASSERT_EQ(*original_->RemoveRecords(1), 1);
  ASSERT_TRUE(original_->Quarantine(3, "reason " + binary).ok());
  ASSERT_TRUE(original_->Keep("name", binary).ok());
  ASSERT_TRUE(original_->Remember("/a " + binary, {7, 1}, {std::string(64, 'a'), 7}).ok());
  const std::string key = *original_->WorkerKey();
  const auto rows = Rows(*original_);
  const int64_t starts = original_->StartCount();
  {
    const auto copy = Open(OwnerOfDigit);
    ASSERT_TRUE(copy->WorkerKey().ok()) << "of a coordinator that was started once and has no records";
    const auto copied = CopyState(*original_, *copy);
    ASSERT_TRUE(copied.ok()) << copied.status();
    EXPECT_EQ(*copied, static_cast<int64_t>(records.size()) - 1);
    EXPECT_TRUE(IsTakenOver(copy->Append({"x"}, Durability::kMachine)));
  }
  const auto copy = Open(OwnerOfDigit);
  EXPECT_TRUE(Rows(*copy) == rows);
  EXPECT_EQ(*copy->WorkerKey(), key);
  EXPECT_GT(copy->StartCount(), starts + (1 << 20));
  EXPECT_TRUE(AllRecords(*copy) == AllRecords(*original_));
  ASSERT_TRUE(copy->Append({"next"}, Durability::kMachine).ok());
  EXPECT_EQ(AllRecords(*copy).back(), "next");
}

TEST_P(StateCopyTest, OnlyToAnEmptyState) {
  ASSERT_TRUE(original_->Append({"original"}, Durability::kMachine).ok());
  const auto copy = Open(OwnerOfDigit);
  ASSERT_TRUE(copy->Append({"another"}, Durability::kMachine).ok());
  EXPECT_EQ(CopyState(*original_, *copy).status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(AllRecords(*copy), testing::ElementsAre("another"));
}

TEST_P(StateCopyTest, NothingIsCopiedIfTheOriginalCannotBeRead) {
  {
    const auto copy = Open(OwnerOfDigit);
    const std::string key = *copy->WorkerKey();
    const auto fill = [](const RowSink& add) -> Status {
      for (int i = 1; i < 5000; ++i) {
        const Status added = add(StateTables()[0], {std::to_string(i), std::string(1000, 'x'), "0", "-1"});
        if (!added.ok()) return added;
      }
      return absl::DataLossError("the original is damaged");
    };
    EXPECT_EQ(copy->Import(fill, 1 << 30).code(), absl::StatusCode::kDataLoss);
    EXPECT_THAT(Rows(*copy), SizeIs(1)) << "its own key";
    EXPECT_EQ(*copy->WorkerKey(), key);
  }
  EXPECT_THAT(AllRecords(*Open(OwnerOfDigit)), IsEmpty());
}

}  // namespace
}  // namespace tessera
