#include "server/tesserad/standby.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "common/log/log.h"
#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"
#include "server/store/state_store.h"
#include "tests/support/notify_socket.h"
#include "tests/support/servers/test_server.h"

namespace tessera {
namespace {

using testing::HasSubstr;

// Keeps values in memory.
class MemoryState final : public StateStore {
 public:
  Status Append(const std::vector<std::string_view>&, Durability) override { return absl::OkStatus(); }
  Status Replay(const std::function<void(const StoredRecord&)>&) override { return absl::OkStatus(); }
  Status Quarantine(int64_t, const std::string&) override { return absl::OkStatus(); }
  StatusOr<std::set<int>> DeletedJobs() override { return std::set<int>(); }
  StatusOr<int> RemoveRecords(int) override { return 0; }
  int64_t StartCount() const override { return 1; }
  std::optional<Digest> Find(const std::string&, const FileStamp&) override { return std::nullopt; }
  Status Remember(const std::string&, const FileStamp&, const Digest&) override { return absl::OkStatus(); }
  std::string Location() const override { return "memory"; }
  StatusOr<std::string> WorkerKey() override { return "key"; }
  StatusOr<std::string> Keep(const std::string& name, const std::string& value) override {
    return kept.emplace(name, value).first->second;
  }
  Status Replace(const std::string& name, const std::string& value) override {
    kept[name] = value;
    return absl::OkStatus();
  }
  double HeldFor_s() const override { return held_for_s; }
  Status Export(const RowSink&) override { return absl::OkStatus(); }
  Status Import(const std::function<Status(const RowSink& add)>&, int64_t) override { return absl::OkStatus(); }
  void Release() override { held_for_s = 0; }

  std::map<std::string, std::string> kept;
  std::atomic<double> held_for_s = 4;
};

class StandbyTest : public testing::Test {
 protected:
  StandbyTest() { EXPECT_TRUE(SetUpLog("off", false).ok()); }
  std::unique_ptr<FolderBlobs> Blobs(const std::string& name) {
    return *FolderBlobs::Open(folder_.path() + "/" + name);
  }
  const TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
};

TEST_F(StandbyTest, ProcessEndsWhenTheRightIsNoLongerCertain) {
  MemoryState state;
  std::promise<void> ended;
  std::atomic<int> ends = 0;
  const RightWatch watch(state, [&](const Status& reason) {
    EXPECT_THAT(std::string(reason.message()), HasSubstr("could not renew"));
    if (++ends == 1) ended.set_value();
  });
  watch.Check();
  EXPECT_EQ(ends, 0);
  state.held_for_s = -0.001;
  watch.Check();  // without waiting for the thread
  EXPECT_GE(ends, 1);
  const int before = ends;
  while (ends < before + 1) std::this_thread::yield();  // the thread notices by itself
}

TEST_F(StandbyTest, ReplacedProcessHasAnExitCodeOfItsOwn) {
  EXPECT_EXIT(
      {
        SetUpLog("info", false).IgnoreError();
        EndReplaced(absl::AbortedError("because"));
      },
      testing::ExitedWithCode(75), "another coordinator has taken over, or may have.*because");
}

TEST_F(StandbyTest, BlobStoreOfAnotherStateIsRefused) {
  MemoryState state;
  const auto blobs = Blobs("blobs"), other = Blobs("other");
  const Digest probe = *MarkStorage(state, {blobs.get(), {}});
  EXPECT_TRUE(blobs->Has(probe));
  EXPECT_EQ(*MarkStorage(state, {blobs.get(), {}}), probe) << "as at every start";
  const Status refused = MarkStorage(state, {other.get(), {}}).status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(refused.message()), testing::AllOf(HasSubstr(other->root()), HasSubstr("--accept-blobs")));
  EXPECT_EQ(*MarkStorage(state, {other.get(), {}, /*accept_blobs=*/true}), probe);
  EXPECT_EQ(*MarkStorage(state, {other.get(), {}}), probe) << "it is one of the state's now";
}

TEST_F(StandbyTest, FirstCoordinatorDoesNotWait) {
  const auto blobs = Blobs("blobs");
  const auto never = [] { return ADD_FAILURE(), true; };
  const auto store = AwaitState(folder_.path() + "/state.sqlite", {blobs.get(), {}}, never);
  ASSERT_TRUE(store.ok()) << store.status();
  EXPECT_EQ(AwaitState(folder_.path() + "/state.sqlite", {blobs.get(), {}}, never).status().code(),
            absl::StatusCode::kFailedPrecondition)
      << "a file of SQLite's has no standby";
}

class SharedStateTest : public StandbyTest {
 protected:
  void SetUp() override {
    TESSERA_NEED_SERVER("postgres");
    const auto* const test = testing::UnitTest::GetInstance()->current_test_info();
    url_ = ServerAddress("postgres") + "?options=-csearch_path%3D" + std::string(test->name()) + RandomName();
    active_ = *OpenState(url_, {.holder = "the active one"});
    ASSERT_TRUE(MarkStorage(*active_, {blobs_.get(), {"/srv/cities", "/srv/towns"}}).ok());
  }
  // Waits until `rounds` looks have found an active coordinator, or the wait ended.
  StatusOr<std::unique_ptr<StateStore>> StandBy(const SharedStorage& storage, int rounds) {
    return AwaitState(url_, storage, [&] { return --rounds < 0; });
  }
  static std::string RandomName() { return std::to_string(std::random_device()()); }

  std::string url_;
  std::unique_ptr<StateStore> active_;
  const std::unique_ptr<FolderBlobs> blobs_ = Blobs("blobs"), other_ = Blobs("other");
};

TEST_F(SharedStateTest, StandbyIsReadyAndWaitsUntilItIsStopped) {
  const NotifySocket manager(folder_.path());
  const auto store = StandBy({blobs_.get(), {"/srv"}}, 2);
  ASSERT_TRUE(store.ok()) << store.status();
  EXPECT_EQ(*store, nullptr);
  EXPECT_GT(active_->HeldFor_s(), 0);
  EXPECT_EQ(manager.Received(), "READY=1");
  EXPECT_EQ(manager.Received(), "") << "told once";
}

TEST_F(SharedStateTest, StandbyTakesOverWhatIsReleased) {
  int looks = 0;
  const auto store = AwaitState(url_, {blobs_.get(), {"/srv"}}, [&] {
    if (++looks == 2) active_->Release();
    return looks > 100;
  });
  ASSERT_TRUE(store.ok()) << store.status();
  ASSERT_NE(*store, nullptr);
  EXPECT_LE(active_->HeldFor_s(), 0);
  EXPECT_GT((*store)->HeldFor_s(), 0);
  EXPECT_TRUE(MarkStorage(**store, {blobs_.get(), {"/srv"}}).ok());
  EXPECT_EQ(*ReadKept(url_, "scene_roots"), "/srv");
}

TEST_F(SharedStateTest, StandbyWithOtherStorageIsRefusedAtOnce) {
  const Status blobs = StandBy({other_.get(), {"/srv"}}, 100).status();
  EXPECT_EQ(blobs.code(), absl::StatusCode::kInvalidArgument) << blobs;
  EXPECT_THAT(std::string(blobs.message()), HasSubstr("--blobs"));
  for (const std::vector<std::string>& lacking :
       {std::vector<std::string>{}, {"/srv/cities"}, {"/srv/cities", "/srv/town"}}) {
    const Status roots = StandBy({blobs_.get(), lacking}, 100).status();
    EXPECT_EQ(roots.code(), absl::StatusCode::kInvalidArgument) << roots;
    EXPECT_THAT(std::string(roots.message()), HasSubstr("as well, which the active coordinator has"));
  }
  for (const std::vector<std::string>& enough : {std::vector<std::string>{"/"}, {"/srv/towns", "/srv/cities", "/a"}}) {
    EXPECT_TRUE(StandBy({blobs_.get(), enough}, 1).ok());
  }
}

}  // namespace
}  // namespace tessera
