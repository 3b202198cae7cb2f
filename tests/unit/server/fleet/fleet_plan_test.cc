#include "server/fleet/fleet_plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "common/base/random.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr double kNow = 10'000;
constexpr int kSmall = 0, kLarge = 1;

// small: 1 GiB, at most 10; large: 8 GiB, at most 4.
struct PlanCase {
  PlanCase() {
    fleet.name = "city";
    fleet.classes.resize(2);
    fleet.classes[kSmall] = {"small", 1024, 1, 3600, 0, 10, 10, {}};
    fleet.classes[kLarge] = {"large", 8192, 1, 3600, 0, 4, 4, {}};
  }
  void Add(int pilot_class, PilotState state, int count = 1, double submitted_s = kNow - 1) {
    for (int i = 0; i < count; ++i) {
      Pilot pilot;
      pilot.job = std::to_string(++jobs);
      if (state != PilotState::kPending) pilot.allocation = pilot.job;
      pilot.pilot_class = pilot_class;
      pilot.state = state;
      pilot.submitted_s = submitted_s;
      pilots.push_back(pilot);
    }
  }
  FleetPlan Plan() const { return PlanFleet(fleet, demand, pilots, workers, backoff, kNow); }
  std::vector<int> Submits() const {
    std::vector<int> counts;
    for (const ClassPlan& plan : Plan().classes) counts.push_back(plan.submit);
    return counts;
  }
  std::string Messages() const {
    std::string all;
    for (const FleetMessage& message : Plan().messages) all += message.text + "\n";
    return all;
  }

  FleetFile fleet;
  FleetDemand demand = {{0, 0}, {}, 0};
  std::vector<Pilot> pilots;
  std::vector<FleetWorker> workers;
  FleetBackoff backoff;
  int jobs = 0;
};

TEST(FleetPlanTest, EmptyFleetGetsWhatEachClassLacks) {
  PlanCase fleet;
  fleet.demand.wanted = {5, 2};  // 2 of them large
  EXPECT_THAT(fleet.Submits(), ElementsAre(3, 2));
}

TEST(FleetPlanTest, NothingIsSubmittedWithoutDemand) {
  PlanCase fleet;
  EXPECT_THAT(fleet.Submits(), ElementsAre(0, 0));
  fleet.Add(kSmall, PilotState::kEnded, 3);
  EXPECT_THAT(fleet.Submits(), ElementsAre(0, 0));
}

TEST(FleetPlanTest, PendingAndRunningPilotsCountAndEndedDoNot) {
  PlanCase fleet;
  fleet.demand.wanted = {5, 0};
  fleet.Add(kSmall, PilotState::kRunning);
  fleet.Add(kSmall, PilotState::kPending, 2);
  fleet.Add(kSmall, PilotState::kEnded, 7);
  EXPECT_THAT(fleet.Submits(), ElementsAre(2, 0));
}

TEST(FleetPlanTest, LargePilotsCountForSmallTasks) {
  PlanCase fleet;
  fleet.demand.wanted = {3, 1};
  fleet.Add(kLarge, PilotState::kRunning, 3);
  EXPECT_THAT(fleet.Submits(), ElementsAre(0, 0));
}

TEST(FleetPlanTest, SmallPilotsDoNotCountForLargeTasks) {
  PlanCase fleet;
  fleet.demand.wanted = {2, 2};
  fleet.Add(kSmall, PilotState::kRunning, 2);
  EXPECT_THAT(fleet.Submits(), ElementsAre(0, 2));
}

TEST(FleetPlanTest, WhatALargeClassLacksIsNotSubmittedAsSmall) {
  PlanCase fleet;
  fleet.demand.wanted = {12, 10};  // at most 4 large
  EXPECT_THAT(fleet.Submits(), ElementsAre(2, 4));
  fleet.Add(kLarge, PilotState::kRunning, 4);
  EXPECT_THAT(fleet.Submits(), ElementsAre(2, 0));
  EXPECT_THAT(fleet.Plan().classes[kLarge].why, HasSubstr("limited to 4 pilots"));
}

TEST(FleetPlanTest, OtherWorkersCount) {
  PlanCase fleet;
  fleet.demand.wanted = {5, 2};
  fleet.workers = {{"workers/1", "", int64_t{32} << 30, false, {}},
                   {"workers/2", "other", int64_t{1} << 30, false, {}},
                   {"workers/3", "", int64_t{1} << 29, false, {}},   // too small for every class
                   {"workers/4", "", int64_t{32} << 30, true, {}}};  // suspended
  EXPECT_THAT(fleet.Submits(), ElementsAre(2, 1));
  EXPECT_EQ(fleet.Plan().classes[kLarge].others, 1);
}

TEST(FleetPlanTest, WorkerOfAPilotIsNotCountedAgain) {
  PlanCase fleet;
  fleet.demand.wanted = {3, 0};
  fleet.Add(kSmall, PilotState::kRunning);
  fleet.Add(kSmall, PilotState::kEnded);  // its worker is not yet forgotten
  for (const char* job : {"1", "2"}) fleet.workers.push_back({"w", job, int64_t{1} << 30, false, {}});
  EXPECT_THAT(fleet.Submits(), ElementsAre(2, 0));
}

TEST(FleetPlanTest, MostAndMostPendingBoundASubmit) {
  PlanCase fleet;
  fleet.demand.wanted = {100, 0};
  EXPECT_THAT(fleet.Submits(), ElementsAre(10, 0));
  fleet.fleet.classes[kSmall].most_pending = 3;
  EXPECT_THAT(fleet.Submits(), ElementsAre(3, 0));
  fleet.Add(kSmall, PilotState::kPending, 2);
  EXPECT_THAT(fleet.Submits(), ElementsAre(1, 0));
  fleet.Add(kSmall, PilotState::kPending, 2);
  EXPECT_THAT(fleet.Submits(), ElementsAre(0, 0)) << "more are pending than may be";
  EXPECT_THAT(fleet.Plan().classes[kSmall].why, HasSubstr("'most_pending'"));
}

TEST(FleetPlanTest, LeastIsKeptWithoutDemand) {
  PlanCase fleet;
  fleet.fleet.classes[kSmall].least = 2;
  EXPECT_THAT(fleet.Submits(), ElementsAre(2, 0));
  fleet.Add(kSmall, PilotState::kRunning);
  fleet.Add(kSmall, PilotState::kPending, 2);
  const FleetPlan plan = fleet.Plan();
  EXPECT_EQ(plan.classes[kSmall].submit, 0);
  EXPECT_THAT(plan.classes[kSmall].cancel, ElementsAre("3"));
}

TEST(FleetPlanTest, LeastOfALargeClassCountsForSmallTasks) {
  PlanCase fleet;
  fleet.fleet.classes[kLarge].least = 2;
  fleet.demand.wanted = {2, 0};
  EXPECT_THAT(fleet.Submits(), ElementsAre(0, 2));
}

TEST(FleetPlanTest, PendingBeyondDemandIsCancelledTheNewestFirst) {
  PlanCase fleet;
  fleet.Add(kSmall, PilotState::kPending, 1, kNow - 5);
  fleet.Add(kSmall, PilotState::kPending, 1, kNow - 9);
  fleet.Add(kSmall, PilotState::kPending, 1, kNow - 7);
  fleet.demand.wanted = {1, 0};
  EXPECT_THAT(fleet.Plan().classes[kSmall].cancel, ElementsAre("1", "3"));
}

TEST(FleetPlanTest, RunningPilotsAreNeverCancelled) {
  PlanCase fleet;
  fleet.Add(kSmall, PilotState::kRunning, 4);
  fleet.Add(kLarge, PilotState::kRunning, 4);
  for (const ClassPlan& plan : fleet.Plan().classes) EXPECT_THAT(plan.cancel, IsEmpty());
}

TEST(FleetPlanTest, PendingLargePilotsStayWhereSmallTasksNeedThem) {
  PlanCase fleet;
  fleet.Add(kLarge, PilotState::kPending, 3);
  fleet.demand.wanted = {2, 0};
  EXPECT_EQ(fleet.Plan().classes[kLarge].cancel.size(), 1u);
  EXPECT_THAT(fleet.Submits(), ElementsAre(0, 0));
}

TEST(FleetPlanTest, SmallPendingIsCancelledAlthoughLargePilotsAreMissing) {
  PlanCase fleet;
  fleet.demand.wanted = {5, 4};
  fleet.backoff.classes["large"] = {0, 1, kNow + 100, "broken", 0, 0};
  fleet.Add(kSmall, PilotState::kPending, 4);
  EXPECT_EQ(fleet.Plan().classes[kSmall].cancel.size(), 3u) << "one has small tasks; none can do the large ones";
}

TEST(FleetPlanTest, StoppedClassGetsNothingAndItsPendingPilotsAreCancelled) {
  PlanCase fleet;
  fleet.demand.wanted = {5, 2};
  fleet.backoff.classes["large"] = {0, 1, kNow + 100, "pilot 7 ended: no such file", 0, 0};
  fleet.Add(kLarge, PilotState::kPending, 2);
  const FleetPlan plan = fleet.Plan();
  EXPECT_EQ(plan.classes[kLarge].submit, 0);
  EXPECT_EQ(plan.classes[kLarge].cancel.size(), 2u);
  EXPECT_EQ(plan.classes[kSmall].submit, 3);
  EXPECT_THAT(plan.classes[kLarge].why, HasSubstr("no such file"));
  EXPECT_THAT(fleet.Messages(), HasSubstr("class large is stopped until"));
}

TEST(FleetPlanTest, AfterAStopOnePilotIsTried) {
  PlanCase fleet;
  fleet.demand.wanted = {5, 0};
  fleet.backoff.classes["small"] = {0, 1, kNow - 1, "broken", 0, 0};
  EXPECT_THAT(fleet.Submits(), ElementsAre(1, 0));
  fleet.Add(kSmall, PilotState::kRunning);
  EXPECT_THAT(fleet.Submits(), ElementsAre(0, 0));
  EXPECT_THAT(fleet.Plan().classes[kSmall].why, HasSubstr("one pilot is tried"));
}

TEST(FleetPlanTest, NothingIsSubmittedWhileAnAnswerIsLost) {
  PlanCase fleet;
  fleet.demand.wanted = {5, 1};
  fleet.backoff.lists_before_submit = 1;
  EXPECT_THAT(fleet.Submits(), ElementsAre(0, 0));
  EXPECT_THAT(fleet.Plan().classes[kSmall].why, HasSubstr("answer of the last submit"));
}

TEST(FleetPlanTest, SubmittedPilotsThatAreNotYetListedCount) {
  PlanCase fleet;
  fleet.demand.wanted = {5, 0};
  fleet.backoff.classes["small"].submitted = 4;
  EXPECT_THAT(fleet.Submits(), ElementsAre(1, 0));
  EXPECT_EQ(fleet.Plan().classes[kSmall].pending, 4);
  fleet.demand.wanted = {0, 0};
  EXPECT_THAT(fleet.Plan().classes[kSmall].cancel, IsEmpty()) << "their jobs are not known";
}

TEST(FleetPlanTest, UnfitTasksAreReported) {
  PlanCase fleet;
  fleet.demand.unfit = {{"jobs/1/tasks/5", "solve tile 3", (int64_t{40} << 30) - 1, 7200}};
  fleet.demand.unfit_count = 12;
  EXPECT_THAT(fleet.Submits(), ElementsAre(0, 0));
  EXPECT_THAT(fleet.Messages(), HasSubstr("12 tasks fit the memory or time limit of no class"));
  EXPECT_THAT(fleet.Messages(), HasSubstr("jobs/1/tasks/5 (solve tile 3): 40960 MiB, 7200 core-seconds"));
}

TEST(FleetPlanTest, LongPendingIsReportedWithTheReasonOfTheOldest) {
  PlanCase fleet;
  fleet.demand.wanted = {3, 0};
  fleet.Add(kSmall, PilotState::kPending, 2, kNow - 299);
  EXPECT_EQ(fleet.Messages(), "");
  fleet.Add(kSmall, PilotState::kPending, 1, kNow - 301);
  fleet.pilots.back().reason = "QOSMaxJobsPerUserLimit";
  EXPECT_THAT(fleet.Messages(), HasSubstr("pilots of class small are pending for more than 5 minutes: QOSMaxJobs"));
  EXPECT_THAT(fleet.Plan().classes[kSmall].why, HasSubstr("QOSMaxJobsPerUserLimit"));
}

// Random fleets: the promises that hold for every plan.
TEST(FleetPlanTest, PlansKeepTheirPromises) {
  Random random(39);
  const auto draw = [&](int end) { return static_cast<int>(random.Below(end)); };
  for (int trial = 0; trial < 5000; ++trial) {
    PlanCase fleet;
    const int classes = 1 + draw(4);
    fleet.fleet.classes.resize(classes);
    fleet.demand.wanted.assign(classes, 0);
    for (int c = 0; c < classes; ++c) {
      const int most = 1 + draw(8);
      const std::string name = "c" + std::to_string(c);
      fleet.fleet.classes[c] = {name, 1024 << c, 1, 3600, draw(3) == 0 ? draw(most + 1) : 0, most, 1 + draw(most), {}};
      if (draw(5) == 0) fleet.backoff.classes[name] = {0, 1, kNow + (draw(2) == 0 ? 10 : -10), "why", 0, 0};
      fleet.Add(c, PilotState::kRunning, draw(5));
      fleet.Add(c, PilotState::kPending, draw(5));
    }
    for (int c = classes; c-- > 0;) {
      fleet.demand.wanted[c] = (c + 1 < classes ? fleet.demand.wanted[c + 1] : 0) + draw(4);
    }
    std::map<std::string, PilotState> states;
    for (const Pilot& pilot : fleet.pilots) states[pilot.job] = pilot.state;
    const FleetPlan plan = fleet.Plan();
    int spare_before = 0, spare_after = 0;  // pilots of larger classes without work
    for (int c = classes; c-- > 0;) {
      const ClassPlan& own = plan.classes[c];
      const PilotClass& limits = fleet.fleet.classes[c];
      const ClassBackoff& state = fleet.backoff.classes[limits.name];
      const int now = own.running + own.pending;
      for (const std::string& job : own.cancel) EXPECT_EQ(states.at(job), PilotState::kPending);
      if (own.submit > 0) {
        EXPECT_THAT(own.cancel, IsEmpty());
        EXPECT_LE(now + own.submit, limits.most);
        EXPECT_LE(own.pending + own.submit, limits.most_pending);
        EXPECT_FALSE(state.StoppedAt(kNow));
        if (state.stops > 0) {
          EXPECT_EQ(now + own.submit, 1);
        }
      }
      const int work = fleet.demand.wanted[c] - (c + 1 < classes ? fleet.demand.wanted[c + 1] : 0);
      const int cancelled = static_cast<int>(own.cancel.size());
      spare_before += state.StoppedAt(kNow) ? own.running : now;
      spare_after += state.StoppedAt(kNow) ? own.running : now - cancelled;
      EXPECT_EQ(std::min(spare_after, work), std::min(spare_before, work))
          << "trial " << trial << " class " << c << ": cancelled pilots had work";
      spare_before -= std::min(spare_before, work);
      spare_after -= std::min(spare_after, work);
      if (state.StoppedAt(kNow)) continue;
      EXPECT_GE(now - cancelled, std::min(now, limits.least));
    }
  }
}

}  // namespace
}  // namespace tessera
