// Acknowledged records survive a crash of the process, durable ones also a failure of the machine; only records at the
// end can be lost.
#include <gtest/gtest.h>

#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/storage/files.h"
#include "server/store/sqlite_store.h"
#include "tests/support/forgetful_disk.h"

namespace tessera {
namespace {

using Left = ForgetfulDisk::Left;

// Batches of one to five records, some longer than a page of the database, that ask for durability now and then.
struct Batch {
  std::vector<std::string> records;
  Durability durability = Durability::kProcess;
};

std::vector<Batch> Batches(Random& random) {
  std::vector<Batch> batches(8);
  int number = 0;
  for (Batch& batch : batches) {
    const int64_t count = 1 + random.Below(5);
    for (int64_t i = 0; i < count; ++i) {
      const auto bytes = static_cast<size_t>(random.Below(8) == 0 ? 9000 : random.Below(400));
      batch.records.push_back("record " + std::to_string(++number) + " " + std::string(bytes, 'r'));
    }
    if (random.Below(2) == 0) batch.durability = Durability::kMachine;
  }
  return batches;
}

class MachineFailureTest : public testing::Test {
 protected:
  struct Written {
    std::vector<std::string> records;  // all that were begun
    std::set<size_t> ends = {0};       // of batches: how many there are up to each
    size_t stored = 0;                 // of these, acknowledged
    size_t durable = 0;                // of these, as durable, or before one that is
  };

  // Opens the store, and checks that it has what it must of `written`, which becomes what it has.
  std::unique_ptr<SqliteStore> Reopen(Written* written) {
    auto store = SqliteStore::Open(path_);
    if (!store.ok()) {
      EXPECT_TRUE(disk_->stopped()) << store.status();
      return nullptr;
    }
    std::vector<std::string> found;
    const Status status = (*store)->Replay([&](const StoredRecord& record) {
      EXPECT_TRUE(record.content.ok()) << record.content.status();
      found.push_back(record.content.value_or("damaged"));
    });
    EXPECT_TRUE(status.ok() || disk_->stopped()) << status;
    if (!status.ok()) return nullptr;
    EXPECT_GE(found.size(), written->durable) << "what was durable is gone";
    EXPECT_TRUE(written->ends.contains(found.size())) << found.size() << " records: half a batch, or too many";
    if (found.size() > written->records.size()) return nullptr;
    written->records.resize(found.size());
    EXPECT_TRUE(found == written->records);
    written->stored = written->durable = found.size();
    return *std::move(store);
  }

  // Until all is stored or the machine stops.
  void Append(SqliteStore& store, const std::vector<Batch>& batches, Written* written) {
    for (const Batch& batch : batches) {
      written->records.insert(written->records.end(), batch.records.begin(), batch.records.end());
      written->ends.insert(written->records.size());
      const Status status = store.Append({batch.records.begin(), batch.records.end()}, batch.durability);
      if (!status.ok()) {
        EXPECT_TRUE(disk_->stopped()) << status;
        return;
      }
      written->stored = written->records.size();
      if (batch.durability == Durability::kMachine) written->durable = written->stored;
    }
  }

  // An empty one, with another path.
  void NewDisk() {
    disk_.reset();
    disk_.emplace();
    path_ = folder_.path() + "/state-" + std::to_string(++disks_) + ".sqlite";
  }

  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  std::optional<ForgetfulDisk> disk_;
  int disks_ = 0;
  std::string path_;
};

// Opens, appends, closes, which writes the log back, and appends more; the machine stops at every step of that in turn.
TEST_F(MachineFailureTest, DurableRecordsSurviveAtEveryStep) {
  Random random(1);
  const std::vector<Batch> first = Batches(random), second = Batches(random);
  const auto life = [&](Written* written) {
    for (const auto* batches : {&first, &second}) {
      const auto store = Reopen(written);
      if (store != nullptr) Append(*store, *batches, written);
      if (disk_->stopped()) return;
    }
  };
  NewDisk();
  Written undisturbed;
  life(&undisturbed);
  const int64_t steps = disk_->steps();
  EXPECT_GT(steps, 50);
  EXPECT_EQ(undisturbed.records.size(), undisturbed.stored);
  size_t lost = 0;
  for (const Left left : {Left::kNothing, Left::kFirst, Left::kAnything, Left::kAll}) {
    for (int64_t step = 1; step <= steps; ++step) {
      SCOPED_TRACE(testing::Message() << "stopped at step " << step << ", left: " << static_cast<int>(left));
      NewDisk();
      disk_->StopAtStep(step);
      Written written;
      life(&written);
      ASSERT_TRUE(disk_->stopped());
      disk_->Restart(left, random);
      if (left == Left::kAll) written.durable = written.stored;  // what the process stored outlives it
      const size_t begun = written.records.size();
      const auto store = Reopen(&written);
      ASSERT_NE(store, nullptr);
      lost += begun - written.records.size();
      Append(*store, {first[0]}, &written);  // it can be gone on with
      EXPECT_EQ(written.stored, written.records.size());
      if (HasFailure()) return;
    }
  }
  EXPECT_GT(lost, 0u) << "the disk forgot nothing: the test shows nothing";
}

}  // namespace
}  // namespace tessera
