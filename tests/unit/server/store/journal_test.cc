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
    if (taken_over_) return absl::AbortedError("another coordinator has taken over");
    batches.emplace_back(records.begin(), records.end());
    durabilities.push_back(durability);
    return absl::OkStatus();
  }
  Status Replay(const std::function<void(const StoredRecord&)>&) override { return absl::OkStatus(); }
  Status Quarantine(int64_t, const std::string&) override { return absl::OkStatus(); }
  StatusOr<std::set<int>> DeletedJobs() override { return std::set<int>(); }
  StatusOr<int> RemoveRecords(int) override { return 0; }
  int64_t StartCount() const override { return 1; }

  void Open(int refusals = 0) {
    std::lock_guard lock(mutex_);
    open_ = true;
    refusals_ = refusals;
    changed_.notify_all();
  }
  void TakeOver() {
    std::lock_guard lock(mutex_);
    taken_over_ = true;
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
  bool open_ = false, taken_over_ = false;
  int asked_ = 0, refusals_ = 0;
};

TEST(JournalTest, RecordsAddedDuringAWriteFormTheNextBatch) {
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

TEST(JournalTest, RetriesUntilSuccessAndReportsOnce) {
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

TEST(JournalTest, CountsWhatItStores) {
  GatedStore store;
  Journal journal(&store, {});
  EXPECT_EQ(journal.stats().batches, 0);
  journal.Add("a", Durability::kProcess);
  store.WaitUntilAsked();
  for (const char* record : {"b", "c", "d"}) journal.Add(record, Durability::kMachine);
  EXPECT_EQ(journal.stats().waiting, 4);
  store.Open(/*refusals=*/2);
  while (!journal.Wait(4).ok()) {
  }
  const JournalStats stats = journal.stats();
  EXPECT_EQ(stats.batches, 2);
  EXPECT_EQ(stats.records, 4);
  EXPECT_EQ(stats.syncs, 1);
  EXPECT_EQ(stats.failed, 2);
  EXPECT_EQ(stats.waiting, 0);
  EXPECT_EQ(stats.seconds.count(), 2);
  EXPECT_EQ(stats.batch_records.sum(), 4);
  EXPECT_EQ(stats.batch_records.counts().at(0), 1) << "a batch of one";
}

TEST(JournalTest, DestructorEndsWhileWritesFail) {
  GatedStore store;
  Journal journal(&store, {.wait_s = 0.02});
  journal.Add("a", Durability::kMachine);
  store.Open(/*refusals=*/1 << 30);
  EXPECT_FALSE(journal.Wait(1).ok());
}

// What the completions were told, in order.
class Told {
 public:
  Journal::Done Next() {
    return [this](const Status& status) {
      std::lock_guard lock(mutex_);
      codes_.push_back(status.code());
      changed_.notify_all();
    };
  }
  size_t count() {
    std::lock_guard lock(mutex_);
    return codes_.size();
  }
  std::vector<absl::StatusCode> Await(size_t count) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return codes_.size() >= count; });
    return codes_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<absl::StatusCode> codes_;
};

constexpr absl::StatusCode kOk = absl::StatusCode::kOk, kUnavailable = absl::StatusCode::kUnavailable;

TEST(JournalTest, CompletionsRunAfterEarlierRecordsAreStored) {
  GatedStore store;
  Told told;
  size_t batches_when_told = 0;
  Journal journal(&store, {});
  journal.WhenStored(told.Next());
  EXPECT_THAT(told.Await(1), ElementsAre(kOk)) << "at once: there is nothing to store";
  journal.Add("a", Durability::kMachine);
  store.WaitUntilAsked();
  journal.Add("b", Durability::kMachine);
  journal.WhenStored([&](const Status& status) {
    batches_when_told = store.batches.size();
    journal.Add("c", Durability::kMachine);  // no lock is held
    told.Next()(status);
  });
  journal.WhenStored(told.Next());
  EXPECT_THAT(told.Await(1), ElementsAre(kOk));
  store.Open();
  EXPECT_THAT(told.Await(3), ElementsAre(kOk, kOk, kOk));
  EXPECT_GE(batches_when_told, 2u);
}

TEST(JournalTest, LateCompletionsFailOnce) {
  GatedStore store;
  Told told;
  {
    Journal journal(&store, {.wait_s = 0.02});
    journal.Add("a", Durability::kMachine);
    journal.WhenStored(told.Next());
    journal.WhenStored(told.Next());
    EXPECT_THAT(told.Await(2), ElementsAre(kUnavailable, kUnavailable));
    store.Open();
    while (!journal.Wait(1).ok()) {
    }
    journal.WhenStored(told.Next());
  }
  EXPECT_THAT(told.Await(3), ElementsAre(kUnavailable, kUnavailable, kOk));
}

TEST(JournalTest, DestructorEndsAllWaits) {
  GatedStore store;
  Told told;
  {
    Journal journal(&store, {});
    journal.Add("a", Durability::kMachine);
    journal.WhenStored(told.Next());
    store.Open();
  }
  EXPECT_THAT(told.Await(1), ElementsAre(kOk)) << "it was stored before the end";
  {
    Journal journal(&store, {.wait_s = 3600});
    store.Open(/*refusals=*/1 << 30);
    journal.Add("b", Durability::kMachine);
    journal.WhenStored(told.Next());
  }
  EXPECT_THAT(told.Await(2), ElementsAre(kOk, kUnavailable));
}

TEST(JournalTest, TakeoverEndsItAndNobodyIsToldOk) {
  GatedStore store;
  Told told;
  std::vector<std::string> troubles, reasons;
  store.Open();
  Journal journal(&store, {.wait_s = 3600,
                           .on_trouble = [&](const Status& trouble) { troubles.emplace_back(trouble.message()); },
                           .on_taken_over =
                               [&](const Status& reason) {
                                 EXPECT_EQ(told.count(), 1u) << "nobody is told before the process knows";
                                 reasons.emplace_back(reason.message());
                               }});
  journal.Add("a", Durability::kMachine);
  journal.WhenStored(told.Next());
  EXPECT_THAT(told.Await(1), ElementsAre(kOk));
  store.TakeOver();
  const int64_t lost = journal.Add("b", Durability::kMachine);
  journal.WhenStored(told.Next());
  EXPECT_THAT(told.Await(2), ElementsAre(kOk, kUnavailable));
  EXPECT_THAT(reasons, ElementsAre(HasSubstr("taken over")));
  EXPECT_THAT(troubles, ElementsAre()) << "it is not tried again";

  const Status later = journal.Wait(lost), earlier = journal.Wait(1);
  EXPECT_EQ(later.code(), kUnavailable);
  EXPECT_THAT(std::string(later.message()), HasSubstr("another coordinator has taken over"));
  EXPECT_EQ(earlier.code(), kUnavailable) << "what was stored may be old by now";
  journal.Add("c", Durability::kMachine);
  journal.WhenStored(told.Next());
  EXPECT_THAT(told.Await(3), ElementsAre(kOk, kUnavailable, kUnavailable));
  EXPECT_FALSE(journal.trouble().ok());
  EXPECT_THAT(store.batches, ElementsAre(ElementsAre("a")));
}

}  // namespace
}  // namespace tessera
