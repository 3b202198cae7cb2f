#include "server/fleet/fleet.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/storage/files.h"
#include "server/fleet/fleet_status.h"
#include "tests/support/fake_clock.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// Jobs in memory; `lists` and `submits` fail on request.
class FakeScheduler : public Scheduler {
 public:
  StatusOr<std::vector<Pilot>> List() override {
    calls.push_back("list");
    if (!list_error.ok()) return list_error;
    return pilots;
  }
  StatusOr<std::string> Submit(const PilotClass& pilot_class, int count) override {
    calls.push_back("submit " + pilot_class.name + " " + std::to_string(count));
    if (on_submit) on_submit();
    if (!submit_error.ok() && !takes_lost_submits) return submit_error;
    for (int i = 0; i < count; ++i) {
      Pilot pilot;
      pilot.job = std::to_string(++jobs);
      pilot.pilot_class = pilot_class.name == "small" ? 0 : 1;
      pilots.push_back(pilot);
    }
    if (!submit_error.ok()) return submit_error;
    return "17\n";
  }
  Status Cancel(const std::vector<std::string>& cancelled) override {
    calls.push_back("cancel " + std::to_string(cancelled.size()));
    return cancel_error;
  }
  std::vector<std::string> TakeCalls() { return std::exchange(calls, {}); }

  Status list_error, submit_error, cancel_error;
  bool takes_lost_submits = false;
  std::function<void()> on_submit;
  std::vector<Pilot> pilots;
  std::vector<std::string> calls;
  int jobs = 0;
};

class FleetTest : public testing::Test {
 protected:
  FleetTest() {
    file_.name = "city";
    file_.classes.resize(2);
    file_.classes[0] = {"small", 1024, 1, 3600, 0, 10, 10, {}};
    file_.classes[1] = {"large", 8192, 1, 3600, 0, 4, 4, {}};
    view_.demand.wanted = {0, 0};
    Restart();
  }
  void Restart(const std::string& file_text = "{}") {
    FleetParts parts;
    parts.ask_coordinator = [this]() -> StatusOr<CoordinatorView> {
      if (!coordinator_error_.ok()) return coordinator_error_;
      return view_;
    };
    parts.scheduler = &scheduler_;
    parts.clock = &clock_;
    parts.backoff_path = folder_.path() + "/backoff.json";
    parts.notify = [this](const FleetMessage& message) { notified_.push_back(message.text); };
    fleet_ = std::make_unique<Fleet>(file_, file_text, std::move(parts));
  }
  std::vector<std::string> TakeMessages() { return std::exchange(notified_, {}); }
  // All pilots end; those of before are still listed.
  void EndAll() {
    for (Pilot& pilot : scheduler_.pilots) {
      pilot.state = PilotState::kEnded;
      pilot.end = PilotEnd::kFailed;
      pilot.reason = "FAILED";
    }
  }

  TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
  FleetFile file_;
  FakeClock clock_;
  FakeScheduler scheduler_;
  CoordinatorView view_;
  Status coordinator_error_;
  std::vector<std::string> notified_;
  std::unique_ptr<Fleet> fleet_;
};

TEST_F(FleetTest, JobsAreListedRightBeforeEachSubmit) {
  view_.demand.wanted = {5, 2};
  EXPECT_TRUE(fleet_->Round().ok());
  EXPECT_THAT(scheduler_.TakeCalls(), ElementsAre("list", "submit large 2", "list", "submit small 3", "list"));
  EXPECT_TRUE(fleet_->Round().ok());
  EXPECT_THAT(scheduler_.TakeCalls(), ElementsAre("list"));
}

// Another fleet of this name submits at the same time: each class exceeds `most` by one array at most.
TEST_F(FleetTest, PilotsOfAnotherFleetAreSeenBeforeTheNextSubmit) {
  view_.demand.wanted = {5, 2};
  scheduler_.on_submit = [&] {
    scheduler_.on_submit = nullptr;
    for (int i = 0; i < 3; ++i) {
      Pilot pilot;
      pilot.job = "other" + std::to_string(i);
      scheduler_.pilots.push_back(pilot);
    }
  };
  EXPECT_TRUE(fleet_->Round().ok());
  EXPECT_THAT(scheduler_.TakeCalls(), ElementsAre("list", "submit large 2", "list"));
}

TEST_F(FleetTest, NothingIsSubmittedWhenTheListIsNotKnown) {
  view_.demand.wanted = {5, 2};
  for (const Status& error : {absl::FailedPreconditionError("squeue ended with exit code 1"),
                              absl::DeadlineExceededError("squeue did not end within 60 s"),
                              absl::InvalidArgumentError("the list of jobs is invalid")}) {
    scheduler_.list_error = error;
    EXPECT_EQ(fleet_->Round(), error);
    EXPECT_THAT(scheduler_.TakeCalls(), ElementsAre("list"));
    EXPECT_THAT(TakeMessages(), ElementsAre(std::string(error.message())));
    EXPECT_EQ(fleet_->Round(), error);
    EXPECT_THAT(scheduler_.TakeCalls(), ElementsAre("list"));
    EXPECT_THAT(TakeMessages(), IsEmpty()) << "reported once";
  }
  scheduler_.list_error = absl::OkStatus();
  EXPECT_TRUE(fleet_->Round().ok());
  EXPECT_EQ(scheduler_.jobs, 5);
  EXPECT_THAT(TakeMessages(), testing::Contains("no longer: the list of jobs is invalid"));
}

TEST_F(FleetTest, NothingHappensWhileTheCoordinatorIsAway) {
  file_.classes[0].least = 3;
  coordinator_error_ = absl::UnavailableError("no coordinator answers at login:7575");
  EXPECT_FALSE(fleet_->Round().ok());
  EXPECT_FALSE(fleet_->Round().ok());
  EXPECT_THAT(scheduler_.TakeCalls(), IsEmpty());
  EXPECT_THAT(TakeMessages(), ElementsAre("no coordinator answers at login:7575"));
  coordinator_error_ = absl::OkStatus();
  EXPECT_TRUE(fleet_->Round().ok());
  EXPECT_EQ(scheduler_.jobs, 3);
}

// The jobs of a submit whose answer was lost may appear in the second list.
TEST_F(FleetTest, LostAnswerIsFollowedByTwoListsBeforeTheNextSubmit) {
  view_.demand.wanted = {5, 2};
  scheduler_.submit_error = absl::DeadlineExceededError("sbatch did not end within 60 s");
  EXPECT_TRUE(fleet_->Round().ok());
  EXPECT_THAT(scheduler_.TakeCalls(), ElementsAre("list", "submit large 2")) << "the other class waits as well";
  scheduler_.submit_error = absl::OkStatus();
  EXPECT_TRUE(fleet_->Round().ok());
  EXPECT_THAT(scheduler_.TakeCalls(), ElementsAre("list"));
  EXPECT_TRUE(fleet_->Round().ok());
  EXPECT_THAT(scheduler_.TakeCalls(), ElementsAre("list", "submit large 2", "list", "submit small 3", "list"));
}

TEST_F(FleetTest, LostAnswerOfASubmitThatWasTakenAddsNoPilots) {
  view_.demand.wanted = {2, 0};
  scheduler_.submit_error = absl::CancelledError("sbatch was interrupted");
  scheduler_.takes_lost_submits = true;
  EXPECT_TRUE(fleet_->Round().ok());
  scheduler_.submit_error = absl::OkStatus();
  Restart();  // the process may be another one
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(fleet_->Round().ok());
  EXPECT_EQ(scheduler_.jobs, 2);
}

TEST_F(FleetTest, PendingBeyondDemandIsCancelled) {
  view_.demand.wanted = {4, 0};
  EXPECT_TRUE(fleet_->Round().ok());
  view_.demand.wanted = {1, 0};
  scheduler_.TakeCalls();
  EXPECT_TRUE(fleet_->Round().ok());
  EXPECT_THAT(scheduler_.TakeCalls(), ElementsAre("list", "cancel 3"));
  EXPECT_THAT(TakeMessages(), testing::Contains("cancelled 3 pending pilots"));
  // A scheduler that does not list them any more: they have not failed.
  scheduler_.pilots.resize(1);
  EXPECT_TRUE(fleet_->Round().ok());
  EXPECT_THAT(ReadFile(folder_.path() + "/backoff.json").value(), Not(HasSubstr("no longer listed")));
}

TEST_F(FleetTest, WrongWorkerIsSubmittedThreeTimesThenStopsTheClass) {
  view_.demand.wanted = {1, 0};
  const std::string output = folder_.path() + "/out";
  ASSERT_TRUE(WriteFileAtomic(output, "pilot: line 9: /wrong/tessera-worker: No such file or directory\n").ok());
  for (int i = 0; i < 20; ++i) {
    EXPECT_TRUE(fleet_->Round().ok());
    EndAll();
    for (Pilot& pilot : scheduler_.pilots) pilot.output = output;
    clock_.Advance(10);
    if (i % 5 == 0) Restart();
  }
  EXPECT_EQ(scheduler_.jobs, 3);
  EXPECT_THAT(TakeMessages(), testing::Contains(testing::AllOf(HasSubstr("class small is stopped until"),
                                                               HasSubstr("/wrong/tessera-worker: No such file"))));
  clock_.Advance(600);
  EXPECT_TRUE(fleet_->Round().ok());
  EXPECT_EQ(scheduler_.jobs, 4) << "one is tried";
}

TEST_F(FleetTest, RefusedSubmitsStopTheClass) {
  view_.demand.wanted = {1, 0};
  scheduler_.submit_error =
      absl::FailedPreconditionError("sbatch ended with exit code 1:\ninvalid partition specified");
  int submits = 0;
  for (int i = 0; i < 20; ++i) {
    EXPECT_TRUE(fleet_->Round().ok());
    for (const std::string& call : scheduler_.TakeCalls()) submits += call.starts_with("submit") ? 1 : 0;
    clock_.Advance(10);
  }
  EXPECT_EQ(submits, 3);
  EXPECT_THAT(TakeMessages(), testing::Contains(HasSubstr("invalid partition specified")));
}

TEST_F(FleetTest, ChangedFileEndsAStop) {
  view_.demand.wanted = {1, 0};
  for (int i = 0; i < 4; ++i) {
    EXPECT_TRUE(fleet_->Round().ok());
    EndAll();
  }
  EXPECT_EQ(scheduler_.jobs, 3);
  Restart("{} ");
  EXPECT_TRUE(fleet_->Round().ok());
  EXPECT_EQ(scheduler_.jobs, 4);
}

TEST_F(FleetTest, DamagedBackoffIsReportedAndReplaced) {
  ASSERT_TRUE(WriteFileAtomic(folder_.path() + "/backoff.json", "{\"classes\": {\"sm").ok());
  Restart();
  EXPECT_THAT(TakeMessages(), ElementsAre(HasSubstr("backoff.json is damaged; an empty back-off is used")));
  view_.demand.wanted = {1, 0};
  EXPECT_TRUE(fleet_->Round().ok());
  EXPECT_EQ(scheduler_.jobs, 1);
  EXPECT_TRUE(ParseBackoff(ReadFile(folder_.path() + "/backoff.json").value()).ok());
}

TEST_F(FleetTest, LookChangesNothing) {
  view_.demand.wanted = {5, 2};
  const auto view = fleet_->Look();
  ASSERT_TRUE(view.ok()) << view.status();
  EXPECT_THAT(scheduler_.TakeCalls(), ElementsAre("list"));
  EXPECT_EQ(view->plan.classes[1].submit, 2);
  EXPECT_FALSE(FileExists(folder_.path() + "/backoff.json"));
}

TEST_F(FleetTest, StatusShowsClassesAndWhatPilotsDo) {
  view_.demand.wanted = {3, 1};
  view_.workers = {{"workers/8", "17", int64_t{8} << 30, false, {"jobs/1/tasks/4"}}};
  Pilot running;
  running.job = "16_1";
  running.allocation = "17";
  running.pilot_class = 1;
  running.state = PilotState::kRunning;
  running.started_s = static_cast<double>(clock_.UnixTimeUs()) * 1e-6 - 65;
  Pilot pending;
  pending.job = "18_1";
  pending.reason = "Resources";
  Pilot starting = running;
  starting.job = "19_1";
  starting.allocation = "20";
  scheduler_.pilots = {running, pending, starting};
  const auto view = fleet_->Look();
  ASSERT_TRUE(view.ok()) << view.status();
  const double now_s = static_cast<double>(clock_.UnixTimeUs()) * 1e-6;
  const std::string text = FleetStatusText(file_, *view, {{"jobs/1/tasks/4", "solve tile 3"}}, now_s);
  EXPECT_THAT(text, HasSubstr("large  8192 MiB  1       2"));
  EXPECT_THAT(text, testing::ContainsRegex("16_1 +large +running +1 min 5 s +workers/8 +solve tile 3"));
  EXPECT_THAT(text, testing::ContainsRegex("18_1 +small +pending +- +- +Resources"));
  EXPECT_THAT(text, testing::ContainsRegex("19_1 .*its worker has not registered"));
  const std::string json = FleetStatusJson(file_, *view, {}, now_s);
  EXPECT_THAT(json, HasSubstr("\"title\": \"jobs/1/tasks/4\""));
  EXPECT_THAT(json, HasSubstr("\"wanted\": 3"));
}

}  // namespace
}  // namespace tessera
