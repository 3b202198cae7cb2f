#include "server/fleet/backoff.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tessera {
namespace {

using testing::HasSubstr;

constexpr double kMinute_s = 60;

class BackoffTest : public testing::Test {
 protected:
  BackoffTest() {
    fleet_.name = "city";
    fleet_.interval_s = 10;
    fleet_.classes.resize(2);
    fleet_.classes[0].name = "small";
    fleet_.classes[1].name = "large";
  }

  Pilot MakePilot(const std::string& job, PilotState state, PilotEnd end = PilotEnd::kFailed, double ran_s = 1) {
    Pilot pilot;
    pilot.job = job;
    if (state != PilotState::kPending) pilot.allocation = "a" + job;
    pilot.state = state;
    pilot.end = end;
    pilot.reason = "FAILED, exit code 127";
    pilot.output = "/out/" + job;
    pilot.started_s = 100;
    pilot.ended_s = 100 + ran_s;
    return pilot;
  }
  Pilot Failed(const std::string& job) { return MakePilot(job, PilotState::kEnded); }

  void Judge(const std::vector<Pilot>& pilots, const std::set<std::string>& allocations = {}) {
    JudgePilots(
        fleet_, pilots, allocations, now_s_, [](const std::string& output) { return "last lines of " + output + "\n"; },
        &backoff_);
    // What is remembered survives the process.
    const auto stored = ParseBackoff(BackoffText(backoff_));
    ASSERT_TRUE(stored.ok()) << stored.status();
    backoff_ = *stored;
  }
  ClassBackoff& Small() { return backoff_.classes["small"]; }
  bool Stopped() { return Small().StoppedAt(now_s_); }

  FleetFile fleet_;
  FleetBackoff backoff_;
  double now_s_ = 1'000'000;
};

TEST_F(BackoffTest, ThreeFailuresInARowStopAClass) {
  Judge({Failed("1")});
  Judge({Failed("1"), Failed("2")});
  EXPECT_EQ(Small().failures, 2) << "each end counts once";
  EXPECT_FALSE(Stopped());
  Judge({Failed("1"), Failed("2"), Failed("3")});
  EXPECT_TRUE(Stopped());
  EXPECT_EQ(Small().retry_s, now_s_ + 10 * kMinute_s);
  EXPECT_EQ(Small().reason,
            "pilot 3 ended before its worker registered (FAILED, exit code 127):\nlast lines of /out/3");
  EXPECT_FALSE(backoff_.classes["large"].StoppedAt(now_s_));
}

TEST_F(BackoffTest, OneIsTriedAfterTenTwentyAndFortyMinutes) {
  Judge({Failed("1"), Failed("2"), Failed("3"), Failed("4"), Failed("5"), Failed("6"), Failed("7")});
  int job = 10;
  for (const double minutes : {10, 20, 40, 40}) {
    EXPECT_EQ(Small().retry_s, now_s_ + minutes * kMinute_s) << "one array stops it once";
    now_s_ = Small().retry_s;
    EXPECT_FALSE(Stopped());
    Judge({Failed(std::to_string(++job))});
    EXPECT_TRUE(Stopped()) << "the failure of the one that is tried suffices";
  }
}

TEST_F(BackoffTest, PilotsThatWereSubmittedBeforeAStopDoNotCountAfterIt) {
  const Pilot late = MakePilot("9", PilotState::kRunning);
  Judge({Failed("1"), Failed("2"), Failed("3"), late});
  now_s_ = Small().retry_s + 1;
  Judge({Failed("9")});
  EXPECT_FALSE(Stopped());
}

TEST_F(BackoffTest, RegisteredPilotResetsTheCount) {
  Judge({Failed("1"), Failed("2"), MakePilot("3", PilotState::kRunning)}, {"a3"});
  EXPECT_EQ(Small().failures, 2);
  Judge({Failed("1"), Failed("2"), Failed("3")});
  EXPECT_EQ(Small().failures, 2) << "3 has registered, although it is no longer a worker";
  Judge({Failed("4"), MakePilot("5", PilotState::kRunning)}, {"a5"});
  EXPECT_EQ(Small().failures, 1) << "5 has registered, then 4 failed";
}

TEST_F(BackoffTest, RegisteredPilotEndsAStop) {
  Judge({Failed("1"), Failed("2"), Failed("3")});
  now_s_ = Small().retry_s;
  Judge({MakePilot("4", PilotState::kRunning)}, {"a4"});
  EXPECT_EQ(Small().stops, 0);
  EXPECT_FALSE(Stopped());
  Judge({Failed("5")});
  EXPECT_FALSE(Stopped());
}

TEST_F(BackoffTest, PilotThatRanAndSucceededHasRegistered) {
  Judge({Failed("1"), Failed("2")});
  Judge({MakePilot("3", PilotState::kEnded, PilotEnd::kSucceeded, 11)});
  EXPECT_EQ(Small().failures, 0);
}

TEST_F(BackoffTest, PilotThatSucceedsAtOnceHasNot) {
  for (const char* job : {"1", "2", "3"}) Judge({MakePilot(job, PilotState::kEnded, PilotEnd::kSucceeded, 9)});
  EXPECT_TRUE(Stopped());
}

TEST_F(BackoffTest, PilotsThatWereTakenAwayDoNotCount) {
  Judge({Failed("1"), Failed("2")});
  for (const char* job : {"3", "4", "5"}) Judge({MakePilot(job, PilotState::kEnded, PilotEnd::kTakenAway)});
  EXPECT_EQ(Small().failures, 2);
}

TEST_F(BackoffTest, PilotThatIsNoLongerListedHasEnded) {
  Judge({MakePilot("1", PilotState::kRunning), MakePilot("2", PilotState::kPending)}, {"a1"});
  Judge({MakePilot("3", PilotState::kRunning)});
  EXPECT_EQ(Small().failures, 1) << "1 has registered; 2 may have run meanwhile";
  EXPECT_THAT(Small().reason, HasSubstr("pilot 2 is no longer listed"));
  backoff_.pilots["3"].judged = true;  // as if cancelled
  Judge({});
  EXPECT_EQ(Small().failures, 1);
}

// As Slurm lists elements of an array that somebody cancelled while they were pending.
TEST_F(BackoffTest, CancelledArrayDoesNotCount) {
  Judge({MakePilot("7_1", PilotState::kPending), MakePilot("7_2", PilotState::kPending)});
  Judge({MakePilot("7", PilotState::kEnded, PilotEnd::kTakenAway)});
  EXPECT_EQ(Small().failures, 0);
}

TEST_F(BackoffTest, SubmittedPilotsThatNoListShowsAreAFailure) {
  CountSubmit(fleet_, 0, 4, now_s_, &backoff_);
  Judge({});
  EXPECT_EQ(Small().submitted, 4);
  now_s_ += 31;
  Judge({});
  EXPECT_EQ(Small().submitted, 0);
  EXPECT_EQ(Small().failures, 1);
}

TEST_F(BackoffTest, SubmittedPilotsAreListed) {
  Judge({MakePilot("1", PilotState::kRunning)}, {"a1"});
  CountSubmit(fleet_, 0, 2, now_s_, &backoff_);
  Judge({MakePilot("1", PilotState::kRunning)}, {"a1"});
  EXPECT_EQ(Small().submitted, 2);
  Judge({MakePilot("1", PilotState::kRunning), MakePilot("2", PilotState::kPending)}, {"a1"});
  EXPECT_EQ(Small().submitted, 0);
}

TEST_F(BackoffTest, LostAnswerIsFollowedByTwoLists) {
  CountLostSubmit(fleet_, 0, "sbatch did not end within 60 s", now_s_, &backoff_);
  EXPECT_EQ(backoff_.lists_before_submit, 2);
  Judge({});
  EXPECT_EQ(backoff_.lists_before_submit, 1);
  Judge({});
  EXPECT_EQ(backoff_.lists_before_submit, 0);
  EXPECT_EQ(Small().failures, 1);
  CountLostSubmit(fleet_, 0, "b", now_s_, &backoff_);
  CountLostSubmit(fleet_, 0, "invalid partition", now_s_, &backoff_);
  EXPECT_TRUE(Stopped());
  EXPECT_EQ(Small().reason, "invalid partition");
}

TEST_F(BackoffTest, DamagedTextIsRefused) {
  for (const char* text : {"", "{", "{}", "[]", "{\"classes\": {\"small\": {}}, \"pilots\": {}}"}) {
    EXPECT_EQ(ParseBackoff(text).status().code(), absl::StatusCode::kInvalidArgument) << text;
  }
}

}  // namespace
}  // namespace tessera
