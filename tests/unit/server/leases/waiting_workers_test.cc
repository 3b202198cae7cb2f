#include "server/leases/waiting_workers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

class WaitingWorkersTest : public testing::Test {
 protected:
  void Add(const std::string& worker, int due_s = 3600) { waiting_.Add({.worker = worker}, At(due_s)); }
  static LeaseCall::Time At(int s) { return LeaseCall::Time(std::chrono::seconds(s)); }
  std::vector<std::string> TakeAll(int now_s) {
    std::vector<std::string> taken;
    while (const auto call = waiting_.TakeDue(At(now_s))) taken.push_back(call->worker);
    return taken;
  }

  WaitingWorkers waiting_;
};

TEST_F(WaitingWorkersTest, EachTaskWakesOneCall) {
  for (const char* worker : {"a", "b", "c"}) Add(worker);
  EXPECT_FALSE(waiting_.WakeNext()) << "no new ready tasks";
  waiting_.ReadyHasGrown();
  EXPECT_TRUE(waiting_.Wake("b"));
  EXPECT_FALSE(waiting_.Wake("b"));
  EXPECT_FALSE(waiting_.Wake("unknown"));
  EXPECT_THAT(TakeAll(0), ElementsAre("b"));
  Add("b");  // tried and did not take the task
  EXPECT_TRUE(waiting_.WakeNext());
  EXPECT_TRUE(waiting_.WakeNext());
  EXPECT_FALSE(waiting_.WakeNext()) << "all have tried";
  EXPECT_THAT(TakeAll(0), ElementsAre("a", "c"));
}

TEST_F(WaitingWorkersTest, CallThatIsNotWokenBecomesDue) {
  EXPECT_FALSE(waiting_.NextDue());
  Add("late", 30);
  Add("soon", 10);
  Add("never", 3600);
  EXPECT_EQ(waiting_.NextDue(), At(10));
  EXPECT_THAT(TakeAll(9), IsEmpty());
  EXPECT_THAT(TakeAll(30), ElementsAre("soon", "late"));
  EXPECT_EQ(waiting_.NextDue(), At(3600));
  EXPECT_TRUE(waiting_.Wake("never"));
  EXPECT_LT(*waiting_.NextDue(), At(0));
  EXPECT_THAT(TakeAll(0), ElementsAre("never"));
  EXPECT_FALSE(waiting_.NextDue());
}

TEST_F(WaitingWorkersTest, TakenCallIsNotWoken) {
  for (const char* worker : {"a", "b"}) Add(worker);
  waiting_.ReadyHasGrown();
  ASSERT_TRUE(waiting_.Wake("a"));
  EXPECT_EQ(waiting_.Take("a")->worker, "a");
  EXPECT_FALSE(waiting_.Take("a"));
  EXPECT_EQ(waiting_.Take("b")->worker, "b");
  waiting_.WakeAll();
  EXPECT_FALSE(waiting_.NextDue());
  EXPECT_THAT(TakeAll(3600), IsEmpty());
}

}  // namespace
}  // namespace tessera
