// A coordinator that is stopped right before it removes a blob, and wakes up after another one has taken over.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <functional>
#include <memory>
#include <random>
#include <string>

#include "common/base/clock.h"
#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"
#include "server/jobs/coordinator.h"
#include "server/ledger/record_owner.h"
#include "server/retention/reclaimer.h"
#include "server/store/state_store.h"
#include "tests/support/servers/test_server.h"

namespace tessera {
namespace {

constexpr int kRemoved = 10, kKept = 11, kBroken = 12;  // exit codes of the collecting process

class StoppedCollectorTest : public testing::Test {
 protected:
  void SetUp() override {
    TESSERA_NEED_SERVER("postgres");
    url_ = ServerAddress("postgres") + "?options=-csearch_path%3Dcollector" + std::to_string(std::random_device()());
  }

  // Another process becomes the active coordinator and finds that nothing needs the blob. Then the test does what it
  // wants, and the process goes on and removes the blob. Returns its exit code.
  int Collect(const Digest& digest, const std::function<void(pid_t collector)>& meanwhile) {
    int found[2], go_on[2];
    EXPECT_EQ(::pipe(found), 0);
    EXPECT_EQ(::pipe(go_on), 0);
    const pid_t collector = ::fork();
    if (collector == 0) {
      ::alarm(60);
      ::_exit(CollectHere(digest, found[1], go_on[0]));
    }
    ::close(found[1]);
    ::close(go_on[0]);
    char byte = 0;
    EXPECT_EQ(::read(found[0], &byte, 1), 1) << "the collector has failed";
    meanwhile(collector);
    EXPECT_EQ(::write(go_on[1], &byte, 1), 1);
    int status = 0;
    EXPECT_EQ(::waitpid(collector, &status, 0), collector);
    ::close(found[0]);
    ::close(go_on[1]);
    return WIFEXITED(status) ? WEXITSTATUS(status) : kBroken;
  }

  std::string url_;
  const TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();

 private:
  int CollectHere(const Digest& digest, int found, int go_on) const {
    const auto blobs = FolderBlobs::Open(folder_.path());
    const auto store = OpenState(url_, {.owner_of = OwnerOfRecord, .holder = "collector"});
    if (!blobs.ok() || !store.ok()) return kBroken;
    SystemClock clock;
    Planner planner;
    const auto coordinator =
        Coordinator::Open({store->get(), blobs->get(), &planner, &clock, /*on_change=*/{}}, DispatchOptions());
    if (!coordinator.ok()) return kBroken;
    // As in server/tesserad/serve.cc.
    Reclaimer reclaimer((*coordinator)->core(), [&] { return (*store)->HeldFor_s() > 2; });
    reclaimer.CollectReferences();
    BlobEntry entry;
    entry.name = digest.sha256.substr(0, 2) + "/" + digest.sha256;
    entry.sha256 = digest.sha256;
    entry.since_us = BlobEntry::kAnyTime;
    while ((*store)->HeldFor_s() < 3) ::usleep(10'000);  // not right before a renewal
    char byte = 0;
    if (::write(found, &byte, 1) != 1 || ::read(go_on, &byte, 1) != 1) return kBroken;
    const auto gone = reclaimer.RemoveBlobs({entry});
    if (!gone.ok()) return kBroken;
    return gone->empty() ? kKept : kRemoved;
  }
};

TEST_F(StoppedCollectorTest, RemovesNothingWhenItWakesUp) {
  const auto blobs = *FolderBlobs::Open(folder_.path());
  const Digest digest = *blobs->PutBytes("unneeded for now");
  EXPECT_EQ(Collect(digest, [](pid_t) {}), kRemoved) << "it is not stopped";
  ASSERT_FALSE(blobs->Has(digest));
  ASSERT_TRUE(blobs->PutBytes("unneeded for now").ok());
  std::unique_ptr<StateStore> next;
  const int ended = Collect(digest, [&](pid_t collector) {
    ::kill(collector, SIGSTOP);
    auto opened = OpenState(url_, {.holder = "the next one", .wait = [](const std::string&, double) { return true; }});
    EXPECT_TRUE(opened.ok()) << opened.status();
    if (opened.ok()) next = *std::move(opened);
    ::kill(collector, SIGCONT);
  });
  EXPECT_EQ(ended, kKept);
  EXPECT_TRUE(blobs->Has(digest));
}

}  // namespace
}  // namespace tessera
