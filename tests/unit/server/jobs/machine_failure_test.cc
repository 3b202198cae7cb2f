// A job whose coordinator is killed, or its machine stops, at any step of what it writes: what was told is kept, and
// the job ends as if nothing had happened.
#include <gtest/gtest.h>

#include <optional>
#include <set>

#include "server/store/sqlite_store.h"
#include "tests/support/fake_coordinator.h"
#include "tests/support/forgetful_disk.h"

namespace tessera {
namespace {

using Left = ForgetfulDisk::Left;

class MachineFailureTest : public CoordinatorTest {
 protected:
  // What the coordinator told somebody.
  struct Told {
    bool accepted = false;
    std::set<std::string> done;  // tasks whose results it took
  };

  MachineFailureTest() {
    planner_.exchange = true;
    job_ = AJob(2);
    job_.request.id = "night";
  }

  // False if the machine stopped at it. `durable_wait_s`: before a call that is not stored is answered so.
  bool Start(double durable_wait_s) {
    options_.durable_wait_s = durable_wait_s;
    auto store = SqliteStore::Open(path_);
    if (!store.ok()) return false;
    sqlite_ = *std::move(store);
    auto coordinator = Coordinator::Open({sqlite_.get(),
                                          blobs_.get(),
                                          &planner_,
                                          &clock_,
                                          {},
                                          [](int64_t, const auto& why) { ADD_FAILURE() << "quarantined: " << why; }},
                                         options_);
    if (!coordinator.ok()) return false;
    coordinator_ = *std::move(coordinator);
    return true;
  }
  void End() {
    coordinator_.reset();
    sqlite_.reset();
  }

  // Repeats a call that a slow disk keeps waiting, until the disk stops. Whether it was answered with OK.
  static bool IsTold(const ForgetfulDisk& disk, const std::function<Status()>& call) {
    Status status = call();
    while (absl::IsUnavailable(status) && !disk.stopped()) status = call();
    return status.ok();
  }
  // From the submission to the end, or until the machine stops.
  Told Live(const ForgetfulDisk& disk) {
    Told told;
    if (!IsTold(disk, [&] { return coordinator_->jobs().CreateJob(job_).status(); })) return told;
    told.accepted = true;
    const std::string worker = Worker();
    while (true) {
      std::optional<GrantedLease> lease;
      const auto ask = [&]() -> Status {
        TESSERA_ASSIGN_OR_RETURN(lease, LeaseAndWait(*coordinator_, worker, 0, {}));
        return absl::OkStatus();
      };
      if (!IsTold(disk, ask)) return told;
      if (!lease) {
        if (disk.stopped() || HasEnded(Job("jobs/1").header.state)) return told;
        clock_.Advance(10);  // one whose lease was not stored in time is tried again
        coordinator_->Tick().IgnoreError();
        continue;
      }
      if (!IsTold(disk, [&] { return Succeed(worker, *lease); })) return told;
      told.done.insert(lease->task);
    }
  }

  // One life with a stop, and the next, to the job's end. False if all was done before that step.
  bool StopsAt(int64_t step, Left left) {
    SCOPED_TRACE(testing::Message() << "stopped at step " << step << ", left: " << static_cast<int>(left));
    ForgetfulDisk disk;
    path_ = folder_.path() + "/state-" + std::to_string(++lives_) + ".sqlite";
    disk.StopAtStep(step);
    Told told;
    if (Start(0.02)) told = Live(disk);
    const bool stopped = disk.stopped();
    End();
    disk.Restart(left, random_);
    [&] {
      ASSERT_TRUE(Start(20));
      CheckKept(told);
      GoOn();
    }();
    End();
    return stopped;
  }
  void CheckKept(const Told& told) {
    const auto jobs = coordinator_->jobs().ListJobs(-1, 10);
    EXPECT_LE(jobs.size(), 1u);
    ASSERT_GE(jobs.size(), told.accepted ? 1u : 0u) << "an accepted job is gone";
    for (const std::string& task : told.done) {
      const auto tasks = coordinator_->jobs().ListTasks("jobs/1", ParseTaskName(task)->task, 1);
      ASSERT_TRUE(tasks.ok() && !tasks->empty()) << task;
      EXPECT_EQ(tasks->at(0).task.state, TaskState::kSucceeded) << task << " was told to be done";
    }
  }
  void GoOn() {
    // The user asks again, as after an answer that never came.
    ASSERT_EQ(Create(job_), "jobs/1");
    clock_.Advance(31);  // whoever had a lease is gone
    ASSERT_TRUE(coordinator_->Tick().ok());
    WorkAll(Worker());
    const JobStatus ended = Job("jobs/1");
    ASSERT_EQ(ended.header.state, JobState::kSucceeded);
    if (!mesh_) mesh_ = ended.header.artifacts.at(0).digest;
    EXPECT_EQ(ended.header.artifacts.at(0).digest, *mesh_);
  }

  Random random_{1};
  NewJob job_;
  std::optional<Digest> mesh_;  // of the first life
  int lives_ = 0;
  std::string path_;
  std::unique_ptr<SqliteStore> sqlite_;
};

TEST_F(MachineFailureTest, AtAnyStepLosesNothingThatWasTold) {
  for (const Left left : {Left::kNothing, Left::kFirst, Left::kAnything, Left::kAll}) {
    int64_t step = 1;
    while (StopsAt(step, left) && !HasFailure()) ++step;
    EXPECT_GT(step, 50);
    if (HasFailure()) return;
  }
}

}  // namespace
}  // namespace tessera
