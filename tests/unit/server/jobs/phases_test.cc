// Jobs with exchange between tiles: phases of planning and placement of tasks on workers.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <utility>

#include "server/jobs/coordinator.h"
#include "tessera/v1/records.pb.h"
#include "tests/support/fake_coordinator.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

// A planner with exchange: the last phase is planned from the reads of all cuts.
class PhasesTest : public CoordinatorTest {
 protected:
  PhasesTest() { planner_.exchange = true; }
  std::string ReadsOf(int tile) override { return tile == bad_tile_ ? bad_reads_ : CoordinatorTest::ReadsOf(tile); }
  // Completes all leased tasks of the kind. Returns their number.
  int WorkOff(const std::string& worker, const std::string& kind) {
    int attempts = 0;
    while (true) {
      const auto lease = Lease(worker);
      if (!lease) return attempts;
      if (lease->plan.kind != kind) {
        EXPECT_TRUE(Fail(worker, *lease, ErrorClass::kPreempted).ok());
        return attempts;
      }
      EXPECT_TRUE(Succeed(worker, *lease).ok());
      ++attempts;
    }
  }
  std::vector<std::string> Names(const std::string& job) {
    std::vector<std::string> names;
    const std::vector<TaskStatus> tasks = *coordinator_->jobs().ListTasks(job, 0, 1000);
    for (const TaskStatus& task : tasks) names.push_back(task.task.plan.name);
    return names;
  }

  int bad_tile_ = -1;
  std::string bad_reads_;
};

TEST_F(PhasesTest, LastPhaseIsPlannedAfterAllCuts) {
  const std::string job = Create(AJob(3)), worker = Worker();
  EXPECT_THAT(Names(job), ElementsAre("read the scene"));
  EXPECT_EQ(WorkOff(worker, "ingest"), 1);
  EXPECT_THAT(Names(job), ElementsAre("read the scene", "cut tile 0", "cut tile 1", "cut tile 2"));
  const auto a = Lease(worker), b = Lease(worker), c = Lease(worker);
  ASSERT_TRUE(a && b && c);
  double progress = Job(job).progress;
  for (const auto* cut : {&*a, &*b}) {
    ASSERT_TRUE(Succeed(worker, *cut).ok());
    EXPECT_EQ(Job(job).tasks_total, 4);
    EXPECT_FALSE(Lease(worker));
    EXPECT_GT(Job(job).progress, progress);
    progress = Job(job).progress;
    EXPECT_EQ(Job(job).tiles_done, 0);
  }
  ASSERT_TRUE(Succeed(worker, *c).ok());
  EXPECT_GE(Job(job).progress, progress);
  EXPECT_THAT(Names(job), ElementsAre("read the scene", "cut tile 0", "cut tile 1", "cut tile 2", "refine tile 0",
                                      "refine tile 1", "refine tile 2", "publish"));
  // Each task reads the tiles that its cut listed.
  const auto refine = Lease(worker);
  ASSERT_TRUE(refine);
  EXPECT_EQ(refine->plan.name, "refine tile 2");
  ASSERT_EQ(refine->inputs.size(), 2u);
  EXPECT_EQ(refine->inputs[0].file.name, "0001/tile.arrays");
  EXPECT_EQ(refine->inputs[1].file.name, "0002/tile.arrays");
  ASSERT_TRUE(Succeed(worker, *refine).ok());
  EXPECT_EQ(Job(job).tiles_done, 1);
  EXPECT_EQ(WorkAll(worker), 3);
  EXPECT_EQ(Job(job).header.state, JobState::kSucceeded);
  EXPECT_EQ(Job(job).progress, 1);
}

TEST_F(PhasesTest, MalformedReadsFailTheJobAndNameTheTile) {
  const std::string worker = Worker();
  const std::string fine = CoordinatorTest::ReadsOf(1);
  for (const auto& [reads, words] : std::vector<std::pair<std::string, std::string>>{
           {"", "parse error"},
           {"{}", "label"},
           {std::string(100000, '['), "nested 100000 levels deep"},
           {std::string(2 << 20, ' '), "has 2097152 bytes, expected at most 1048576"},
           {fine + " ", "canonical"},
           {R"({"label":[0,1],"mend":[0,1.5],"sight":[0,1],"solve":[0,1]})", "expected an integer within range"},
           {R"({"label":[0,1],"mend":[0,1],"sight":[0,1,2],"solve":[0,1]})", "sight: found tile 2, expected 0 to 1"},
           {R"({"label":[0,1],"mend":[0,1],"sight":[1],"solve":[1,0]})", "solve: found tile 0 after 1"},
           {R"({"label":[0],"mend":[0,1],"sight":[1],"solve":[0,1]})", "label: expected the tile itself, 1"}}) {
    bad_tile_ = 1;
    bad_reads_ = reads;
    const std::string job = Create(AJob(2, "scene " + words + std::to_string(reads.size())));
    WorkAll(worker);
    EXPECT_EQ(Job(job).header.state, JobState::kFailed);
    EXPECT_THAT(Job(job).header.error, HasSubstr("cannot plan the job: tile 1: "));
    EXPECT_FALSE(Job(job).header.bad_input) << "a fault of a worker, not of the scene";
    EXPECT_THAT(Job(job).header.error, HasSubstr(words));
  }
}

TEST_F(PhasesTest, CutWithoutReadsFailsTheJob) {
  const std::string job = Create(AJob(1)), worker = Worker();
  WorkOff(worker, "ingest");
  const auto cut = Lease(worker);
  ASSERT_TRUE(cut);
  ReportedResult result = Result(*cut);
  result.outputs.pop_back();
  ASSERT_TRUE(ReportSuccessAndWait(*coordinator_, worker, cut->task, cut->attempt, result).ok());
  EXPECT_EQ(Job(job).header.error, "cannot plan the job: tile 0: no output reads.json of 'cut tile 0' yet");
}

TEST_F(PhasesTest, ResultsAreReusedAcrossPhases) {
  const std::string worker = Worker();
  Create(AJob(3));
  EXPECT_EQ(WorkAll(worker), 8);
  const std::string again = Create(AJob(3));
  EXPECT_EQ(Job(again).header.state, JobState::kSucceeded) << "all phases, without a worker";
  // Only the new tile and publish run.
  const std::string more = Create(AJob(4));
  EXPECT_EQ(WorkAll(worker), 3);
  EXPECT_EQ(Job(more).header.state, JobState::kSucceeded);
}

TEST_F(PhasesTest, CancelledBetweenPhases) {
  const std::string job = Create(AJob(2)), worker = Worker();
  WorkOff(worker, "ingest");
  const auto first = Lease(worker), last = Lease(worker);
  ASSERT_TRUE(first && last);
  ASSERT_TRUE(Succeed(worker, *first).ok());
  EXPECT_EQ(coordinator_->jobs().CancelJob(job)->header.state, JobState::kCancelled);
  EXPECT_FALSE(Succeed(worker, *last).ok());
  ASSERT_TRUE(coordinator_->Tick().ok());
  EXPECT_EQ(Job(job).tasks_total, 3);
  EXPECT_FALSE(Lease(worker));
}

TEST_F(PhasesTest, RestartedBetweenPhases) {
  const std::string job = Create(AJob(2)), worker = Worker();
  WorkOff(worker, "ingest");
  const auto first = Lease(worker), last = Lease(worker);
  ASSERT_TRUE(Succeed(worker, *first).ok());
  ASSERT_TRUE(Succeed(worker, *last).ok());
  coordinator_.reset();
  store_.records.pop_back();  // the report is stored, the plan is not
  Restart();
  EXPECT_EQ(Job(job).tasks_total, 3);
  ASSERT_TRUE(coordinator_->Tick().ok());
  EXPECT_EQ(Job(job).tasks_total, 6);
  WorkAll(Worker());
  EXPECT_EQ(Job(job).header.state, JobState::kSucceeded);
}

// A plan in several records without its last one: none of its tasks is leased, and the job is planned again.
TEST_F(PhasesTest, PlanWithoutItsLastRecordIsRepeated) {
  const std::string job = Create(AJob(2)), worker = Worker();
  WorkOff(worker, "ingest");
  WorkOff(worker, "cut");
  const std::vector<std::string> names = Names(job);
  ASSERT_EQ(names.size(), 6u);
  for (size_t cut = 0; cut < store_.records.size(); ++cut) {
    v1::Record record;
    ASSERT_TRUE(record.ParseFromString(store_.records[cut]));
    if (!record.has_tasks_planned() || record.tasks_planned().first_task() != 3) continue;
    v1::TasksPlanned& planned = *record.mutable_tasks_planned();
    planned.mutable_tasks()->DeleteSubrange(2, planned.tasks_size() - 2);
    planned.set_more(true);
    store_.records.resize(cut);
    store_.records.push_back(record.SerializeAsString());
  }
  Restart();
  EXPECT_EQ(Job(job).tasks_total, 5);
  const std::string next = Worker();
  EXPECT_FALSE(Lease(next));
  ASSERT_TRUE(coordinator_->Tick().ok());
  EXPECT_EQ(Names(job), names);
  EXPECT_EQ(WorkAll(next), 3);
  EXPECT_EQ(Job(job).header.state, JobState::kSucceeded);
}

TEST_F(PhasesTest, WorkerGetsTasksOfItsTile) {
  const std::string a = Worker(), b = Worker();
  Create(AJob(4));
  WorkOff(a, "ingest");
  // Cuts 0 and 2 go to a, 1 and 3 to b.
  for (int tile = 0; tile < 4; ++tile) {
    const auto cut = Lease(tile % 2 == 0 ? a : b);
    ASSERT_TRUE(cut);
    EXPECT_EQ(cut->plan.tile, tile);
    ASSERT_TRUE(Succeed(tile % 2 == 0 ? a : b, *cut).ok());
  }
  // Tile 3 has the highest cost, but b has it; a gets its last tile.
  EXPECT_EQ(Lease(a)->plan.name, "refine tile 2");
  EXPECT_EQ(Lease(a)->plan.name, "refine tile 0");
  // An idle worker gets any task.
  EXPECT_EQ(Lease(a)->plan.name, "refine tile 3");
  EXPECT_EQ(Lease(b)->plan.name, "refine tile 1");
}

TEST_F(PhasesTest, TileOfAnUnregisteredWorkerGoesToAnyWorker) {
  const std::string a = Worker(), b = Worker();
  Create(AJob(2));
  WorkOff(a, "ingest");
  const auto on_a = Lease(a), on_b = Lease(b);
  ASSERT_TRUE(Succeed(a, *on_a).ok());
  ASSERT_TRUE(Succeed(b, *on_b).ok());
  ASSERT_TRUE(UnregisterAndWait(*coordinator_, b).ok());
  const std::string c = Worker();
  EXPECT_EQ(Lease(c)->plan.name, "refine tile 1");
  EXPECT_EQ(Lease(c)->plan.name, "refine tile 0");
}

TEST_F(PhasesTest, TilesOfOtherWorkersNeverKeepAWorkerIdle) {
  const std::string a = Worker(), b = Worker();
  Create(AJob(60));
  WorkOff(a, "ingest");
  WorkOff(a, "cut");
  for (int i = 0; i < 60; ++i) EXPECT_TRUE(Lease(b)) << i;
}

}  // namespace
}  // namespace tessera
