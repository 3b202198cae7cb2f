// Several files of a task are moved at once.
#include "worker/agent/task_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/log/log.h"
#include "common/rpc/channel.h"
#include "common/storage/files.h"
#include "tests/support/fake_workers_service.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

constexpr int kInputs = 40;

class TaskFilesTest : public testing::Test {
 protected:
  TaskFilesTest() : folder_(TempFolder::Create(testing::TempDir()).value()) {
    EXPECT_TRUE(SetUpLog("off", false).ok());
    RetryPolicy once;
    once.max_attempts = 1;
    const auto sleeper = [](double) { return true; };
    files_ = std::make_unique<TaskFiles>(BlobClient(MakeChannel(coordinator_.address()), once, sleeper),
                                         *BlobCache::Open(folder_.path() + "/cache", int64_t{1} << 30), true,
                                         TaskFiles::StorageWait{0, once, sleeper});
    for (const char* name : {"/in", "/out"}) EXPECT_TRUE(EnsureFolder(folder_.path() + name).ok());
    for (int i = 0; i < kInputs; ++i) {
      inputs_.push_back({"sub/" + std::to_string(i), coordinator_.blobs().Add(ContentOf(i)), ""});
    }
    // One call at a time, as TaskFiles says.
    control_.report = [this](double, const std::string& stage) {
      EXPECT_FALSE(is_called_.exchange(true));
      stages_.push_back(stage);
      is_called_ = false;
    };
    control_.cancelled = [this] {
      EXPECT_FALSE(is_called_.exchange(true));
      const bool cancelled = cancel_after_ >= 0 && --cancel_after_ < 0;
      if (cancelled) cancel_after_ = 0;
      is_called_ = false;
      return cancelled;
    };
  }
  static std::string ContentOf(int i) { return "content of " + std::to_string(i); }
  Status Bring() { return files_->BringInputs(inputs_, folder_.path() + "/in", control_); }

  TempFolder folder_;
  FakeWorkersService coordinator_;
  std::unique_ptr<TaskFiles> files_;
  std::vector<TaskInput> inputs_;
  TaskControl control_;
  std::atomic<bool> is_called_ = false;
  std::vector<std::string> stages_;
  int cancel_after_ = -1;  // calls; -1: never
};

TEST_F(TaskFilesTest, InputsAreFetchedSeveralAtOnce) {
  coordinator_.blobs().GatherStreams(BlobStore::kCallsAtOnce);
  ASSERT_TRUE(Bring().ok());
  EXPECT_EQ(coordinator_.blobs().most_streams_at_once(), BlobStore::kCallsAtOnce);
  for (int i = 0; i < kInputs; ++i) {
    EXPECT_EQ(ReadFile(folder_.path() + "/in/" + inputs_[i].name).value_or(""), ContentOf(i)) << i;
  }
  EXPECT_EQ(stages_.front(), "fetching inputs: 0 of 40, 0.0 of 0.0 MB");
  EXPECT_EQ(stages_.back(), "fetching inputs: 40 of 40, 0.0 of 0.0 MB");
  EXPECT_TRUE(files_->CheckInputs(true).ok());
  files_->Release();
  EXPECT_THAT(*ListFiles(folder_.path() + "/in"), IsEmpty());
}

TEST_F(TaskFilesTest, InputsOfEqualContentAreFetchedOnce) {
  for (TaskInput& input : inputs_) input.digest = inputs_[0].digest;
  ASSERT_TRUE(Bring().ok());
  EXPECT_THAT(coordinator_.blobs().read_offsets(), SizeIs(1));
}

TEST_F(TaskFilesTest, AllLostInputsAreReportedInOrder) {
  const Digest gone{std::string(64, 'a'), 5}, damaged = inputs_[11].digest;
  inputs_[30].digest = gone;
  coordinator_.blobs().Replace(damaged, "CONTENT OF 11");
  const Failure failure = FailureOf(Bring());
  EXPECT_EQ(failure.failure_class, FailureClass::kLostInput);
  EXPECT_THAT(failure.message, HasSubstr("input sub/11: "));
  EXPECT_THAT(failure.lost_inputs, ElementsAre(damaged, gone));
}

// Input 12 fails first in time, and 7 is the first in order.
TEST_F(TaskFilesTest, FirstFailureInTheOrderOfInputsIsReported) {
  inputs_[3].digest = {std::string(64, 'a'), 5};  // lost
  coordinator_.blobs().Forbid(inputs_[12].digest);
  coordinator_.blobs().Forbid(inputs_[7].digest, 1);
  const Failure failure = FailureOf(Bring());
  EXPECT_EQ(failure.failure_class, FailureClass::kPeer);
  EXPECT_EQ(failure.message, "input sub/7: not yours");
  EXPECT_LT(coordinator_.blobs().read_offsets().size(), 2 * BlobStore::kCallsAtOnce) << "the others are not fetched";
}

TEST_F(TaskFilesTest, NamesAreCheckedBeforeAnythingIsFetched) {
  inputs_[39].name = inputs_[38].name;
  Failure failure = FailureOf(Bring());
  EXPECT_EQ(failure.failure_class, FailureClass::kInput);
  EXPECT_EQ(failure.message, "found two inputs of the same name: sub/38");
  inputs_[39].name = "../outside";
  failure = FailureOf(Bring());
  EXPECT_EQ(failure.failure_class, FailureClass::kInput);
  EXPECT_THAT(coordinator_.blobs().read_offsets(), IsEmpty());
}

TEST_F(TaskFilesTest, CancellationEndsAllFetches) {
  cancel_after_ = 20;
  EXPECT_EQ(Bring().code(), absl::StatusCode::kCancelled);
  EXPECT_LT(coordinator_.blobs().read_offsets().size(), 2 * BlobStore::kCallsAtOnce);
}

TEST_F(TaskFilesTest, OutputsAreSentSeveralAtOnce) {
  std::vector<std::string> names;
  for (int i = 0; i < 30; ++i) {
    names.push_back("output " + std::to_string(i));
    ASSERT_TRUE(WriteFileAtomic(folder_.path() + "/out/" + names.back(), "made " + std::to_string(i)).ok());
  }
  coordinator_.blobs().GatherStreams(BlobStore::kCallsAtOnce);
  const auto outputs = files_->StoreOutputs(names, folder_.path() + "/out", control_);
  ASSERT_TRUE(outputs.ok()) << outputs.status();
  EXPECT_EQ(coordinator_.blobs().most_streams_at_once(), BlobStore::kCallsAtOnce);
  for (int i = 0; i < 30; ++i) {
    EXPECT_EQ(outputs->at(i).name, names[i]);
    EXPECT_EQ(coordinator_.blobs().Content(outputs->at(i).digest), "made " + std::to_string(i));
  }
  EXPECT_EQ(stages_.back(), "storing outputs: 30 of 30, 0.0 of 0.0 MB");
}

TEST_F(TaskFilesTest, FailedOutputIsNamed) {
  std::vector<std::string> names;
  for (int i = 0; i < 30; ++i) {
    names.push_back("output " + std::to_string(i));
    ASSERT_TRUE(WriteFileAtomic(folder_.path() + "/out/" + names.back(), "made " + std::to_string(i)).ok());
  }
  names.push_back("output 3");
  const auto twice = files_->StoreOutputs(names, folder_.path() + "/out", control_);
  EXPECT_EQ(FailureOf(twice.status()).failure_class, FailureClass::kInternal);
  EXPECT_THAT(FailureOf(twice.status()).message, HasSubstr("output 3"));
  names.pop_back();
  coordinator_.blobs().RefuseUploads(1000);
  const auto refused = files_->StoreOutputs(names, folder_.path() + "/out", control_);
  EXPECT_EQ(FailureOf(refused.status()).failure_class, FailureClass::kStorage);
  EXPECT_THAT(FailureOf(refused.status()).message, HasSubstr("output output 0: "));
}

}  // namespace
}  // namespace tessera
