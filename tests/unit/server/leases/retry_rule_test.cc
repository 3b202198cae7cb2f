#include "server/leases/retry_rule.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tessera {
namespace {

using testing::HasSubstr;

// A task with these earlier attempts and a last one that has just ended.
JobTask After(std::vector<Attempt> attempts, const std::string& machine = "m") {
  JobTask task;
  task.plan.name = "refine tile 3";
  task.attempts.assign(attempts.begin(), attempts.end());
  task.attempts.push_back({"workers/1-9", machine, 0, 0, {}, false});
  return task;
}
Attempt Failed(ErrorClass error_class) {
  return {"workers/1-1", "m", 0, 1, TaskFailure{error_class, "it broke"}, false};
}
Attempt Silent(const std::string& machine) {
  return {"workers/1-1", machine, 0, 1, TaskFailure{ErrorClass::kTransient, "lease expired"}, true};
}
bool AllLive(const std::string&) { return true; }
bool NoneLives(const std::string&) { return false; }

TEST(RetryRule, FailuresCountByClass) {
  const RetryOptions options;
  const auto decide = [&](std::vector<Attempt> before, ErrorClass now) {
    return DecideAfterFailure(After(std::move(before)), {now, "it broke"}, options);
  };
  const Attempt transient = Failed(ErrorClass::kTransient), memory = Failed(ErrorClass::kMemory);
  EXPECT_EQ(decide({}, ErrorClass::kTransient).delay_s, 1);
  EXPECT_EQ(decide({memory, transient, transient}, ErrorClass::kTransient).delay_s, 4);
  EXPECT_FALSE(decide({memory, transient, transient}, ErrorClass::kInternal).final);
  EXPECT_TRUE(decide({transient, Failed(ErrorClass::kInternal), transient}, ErrorClass::kTransient).final);
  EXPECT_FALSE(decide({transient, transient, transient}, ErrorClass::kMemory).final);
  EXPECT_TRUE(decide({memory}, ErrorClass::kMemory).final);
  EXPECT_TRUE(decide({}, ErrorClass::kPoison).final);
  EXPECT_EQ(decide({}, ErrorClass::kNone).failure.error_class, ErrorClass::kInternal);
}

// Failures of scratch folders, storage and the network, and unconfirmed lost inputs, do not count against a task.
TEST(RetryRule, CausesOutsideTheTaskNeverFailIt) {
  for (const ErrorClass error_class : {ErrorClass::kScratch, ErrorClass::kStorage, ErrorClass::kPeer,
                                       ErrorClass::kLostInput, ErrorClass::kPreempted}) {
    const RetryDecision decision =
        DecideAfterFailure(After(std::vector<Attempt>(2000, Failed(error_class))), {error_class, "it broke"}, {});
    EXPECT_FALSE(decision.final) << ErrorClassName(error_class);
    EXPECT_EQ(decision.delay_s, RuleOf(error_class, {}).delays ? 60 : 0) << ErrorClassName(error_class);
    EXPECT_NE(RuleOf(error_class, {}).counts_against, CountsAgainst::kTask) << ErrorClassName(error_class);
  }
}

TEST(RetryRule, InputIsWrongIfTwoWorkersReportIt) {
  OtherWorkers several;
  several.alone = false;
  const Attempt by_one = Failed(ErrorClass::kInput);  // workers/1-1; After adds workers/1-9
  const auto decide = [](std::vector<Attempt> before, const OtherWorkers& others) {
    return DecideAfterFailure(After(std::move(before)), {ErrorClass::kInput, "line 3"}, {}, others);
  };
  Attempt same = by_one;
  same.worker = "workers/1-9";
  EXPECT_FALSE(decide({}, several).final);
  EXPECT_FALSE(decide({same}, several).final);
  EXPECT_TRUE(decide({by_one}, several).final);
  EXPECT_FALSE(decide({}, {}).final);
  EXPECT_EQ(decide({}, {}).delay_s, 1);
  EXPECT_TRUE(decide({same}, {}).final);
  several.ignored = [](const std::string& worker) { return worker == "workers/1-1"; };
  EXPECT_FALSE(decide({by_one}, several).final) << "the first worker is not trusted";
}

TEST(RetryRule, UnregisteringDoesNotCountAgainstTheTask) {
  const std::vector<Attempt> left(100, Failed(ErrorClass::kPreempted));
  const RetryDecision decision = DecideAfterFailure(After(left), {ErrorClass::kPreempted, "it has left"}, {});
  EXPECT_FALSE(decision.final);
  EXPECT_EQ(decision.delay_s, 0);
  EXPECT_EQ(DecideAfterFailure(After(left), {ErrorClass::kTransient, ""}, {}).delay_s, 1);
}

TEST(RetryRule, SilenceCountsIfTheMachineIsAlive) {
  EXPECT_FALSE(DecideAfterExpiry(After({Silent("m")}), true, AllLive, {}).final);
  const RetryDecision third =
      DecideAfterExpiry(After({Silent("m"), Failed(ErrorClass::kPreempted), Silent("n")}), true, AllLive, {});
  EXPECT_TRUE(third.final);
  EXPECT_EQ(third.failure.error_class, ErrorClass::kPoison);
  EXPECT_THAT(third.failure.message, HasSubstr("workers/1-9 fell silent during 'refine tile 3': the task lost 3"));
  EXPECT_FALSE(DecideAfterExpiry(After(std::vector<Attempt>(50, Silent("gone"))), true, NoneLives, {}).final);
  // A machine that comes back later makes the silence count.
  const auto lives = [](const std::string& machine) { return machine != "gone"; };
  EXPECT_FALSE(DecideAfterExpiry(After({Silent("a"), Silent("gone")}), true, lives, {}).final);
  EXPECT_TRUE(DecideAfterExpiry(After({Silent("a"), Silent("gone"), Silent("b")}), true, lives, {}).final);
  EXPECT_FALSE(DecideAfterExpiry(After({Silent("a"), Silent("b")}, "gone"), true, lives, {}).final);
  // A worker that has not called since the coordinator restarted does not count.
  const RetryDecision unheard = DecideAfterExpiry(After({Silent("a"), Silent("b")}), false, AllLive, {});
  EXPECT_FALSE(unheard.final);
  EXPECT_EQ(unheard.failure.error_class, ErrorClass::kPreempted);
  Attempt before = Silent("c");
  before.failure = unheard.failure;
  EXPECT_FALSE(DecideAfterExpiry(After({Silent("a"), before, before}), true, AllLive, {}).final);
  EXPECT_TRUE(DecideAfterExpiry(After({Silent("a"), before, Silent("b")}), true, AllLive, {}).final);
}

TEST(RetryRule, StallLimitIsTenTimesThePredictedTime) {
  PlannedTask plan;
  plan.cost = 100;
  EXPECT_EQ(StallLimit_s(plan, 2, 600), 600);
  EXPECT_EQ(StallLimit_s(plan, 1, 600), 1000);
  LeaseState lease;
  lease.worker = "workers/1-1";
  lease.progress = 0.25;
  lease.stage = "mending";
  const TaskFailure stall = StallOf(lease, 600);
  EXPECT_EQ(stall.error_class, ErrorClass::kTransient);
  EXPECT_EQ(stall.message, "stalled: workers/1-1 showed no progress for 600 s, at 25 % (mending)");
}

}  // namespace
}  // namespace tessera
