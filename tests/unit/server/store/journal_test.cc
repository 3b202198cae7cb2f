#include "server/store/journal.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

// Takes batches only while it is open, and may refuse some.
class GatedStore : public RecordStore {
 public:
  Status Append(const std::vector<std::string_view>& records, Durability durability) override {
    std::unique_lock lock(mutex_);
    ++asked_;
    changed_.notify_all();
    changed_.wait(lock, [&] { return open_; });
    if (refusals_ > 0) {
      --refusals_;
      return absl::ResourceExhaustedError("disk full");
    }
    batches.emplace_back(records.begin(), records.end());
    durabilities.push_back(durability);
    return absl::OkStatus();
  }
  Status Replay(const std::function<void(const StoredRecord&)>&) override { return absl::OkStatus(); }
  Status SetAside(int64_t, const std::string&) override { return absl::OkStatus(); }
  int64_t StartCount() const override { return 1; }

  void Open(int refusals = 0) {
    std::lock_guard lock(mutex_);
    open_ = true;
    refusals_ = refusals;
    changed_.notify_all();
  }
  void WaitUntilAsked() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return asked_ > 0; });
  }

  std::vector<std::vector<std::string>> batches;
  std::vector<Durability> durabilities;

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool open_ = false;
  int asked_ = 0, refusals_ = 0;
};

TEST(JournalTest, WhatComesWhileABatchIsStoredIsTheNextBatch) {
  GatedStore store;
  std::vector<std::string> told;
  {
    Journal journal(&store, {.on_stored = [&](const std::string& record) { told.push_back(record); }});
    EXPECT_EQ(journal.Add("a", Durability::kProcess), 1);
    store.WaitUntilAsked();
    for (const char* record : {"b", "c", "d"}) {
      journal.Add(record, *record == 'c' ? Durability::kMachine : Durability::kProcess);
    }
    EXPECT_EQ(journal.last(), 4);
    store.Open();
    EXPECT_TRUE(journal.Wait(4).ok());
    EXPECT_TRUE(journal.Wait(0).ok());
  }
  EXPECT_THAT(store.batches, ElementsAre(ElementsAre("a"), ElementsAre("b", "c", "d")));
  EXPECT_THAT(store.durabilities, ElementsAre(Durability::kProcess, Durability::kMachine));
  EXPECT_THAT(told, ElementsAre("a", "b", "c", "d"));
}

TEST(JournalTest, TriesAgainUntilItCanAndTellsOnce) {
  GatedStore store;
  std::vector<std::string> troubles;
  {
    Journal journal(&store, {.wait_s = 0.02,
                             .on_trouble = [&](const Status& trouble) { troubles.emplace_back(trouble.message()); }});
    const int64_t number = journal.Add("a", Durability::kMachine);
    store.Open(/*refusals=*/3);
    Status status = journal.Wait(number);
    while (!status.ok()) {
      EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
      status = journal.Wait(number);
    }
    EXPECT_TRUE(journal.trouble().ok());
  }
  EXPECT_THAT(store.batches, ElementsAre(ElementsAre("a")));
  EXPECT_THAT(troubles, ElementsAre(HasSubstr("disk full"), ""));
}

TEST(JournalTest, EndsThoughNothingCanBeStored) {
  GatedStore store;
  Journal journal(&store, {.wait_s = 0.02});
  journal.Add("a", Durability::kMachine);
  store.Open(/*refusals=*/1 << 30);
  EXPECT_FALSE(journal.Wait(1).ok());
}

}  // namespace
}  // namespace tessera
