#include "server/leases/thread_rule.h"

#include <gtest/gtest.h>

namespace tessera {
namespace {

int Threads(int cores, int workers, int running, int ready, int most = 1000) {
  return ThreadsOfTask({cores, workers, running}, ready, most);
}

TEST(ThreadRule, SingleTaskGetsTheMachine) {
  EXPECT_EQ(Threads(2, 2, 1, 0), 2);
  EXPECT_EQ(Threads(64, 16, 1, 0), 64);
}

TEST(ThreadRule, TasksThatWillRunShareTheCores) {
  EXPECT_EQ(Threads(2, 2, 1, 1), 1) << "a second task will run";
  EXPECT_EQ(Threads(2, 2, 2, 0), 1);
  EXPECT_EQ(Threads(2, 2, 1, 100), 1);
  EXPECT_EQ(Threads(16, 4, 1, 2), 5);
  EXPECT_EQ(Threads(16, 4, 4, 100), 4);
  EXPECT_EQ(Threads(16, 1, 1, 100), 16) << "one worker runs one task at a time";
}

TEST(ThreadRule, AtLeastOneAndAtMostTheWorkersLimit) {
  EXPECT_EQ(Threads(2, 8, 8, 100), 1);
  EXPECT_EQ(Threads(16, 2, 1, 0, 4), 4);
  EXPECT_EQ(Threads(16, 8, 8, 0, 4), 2);
  EXPECT_EQ(Threads(16, 2, 1, 0, 0), 1);
  EXPECT_EQ(Threads(0, 2, 1, 0, 3), 3) << "cores of the host are unknown";
}

}  // namespace
}  // namespace tessera
