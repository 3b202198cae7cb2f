// The coordinator is killed, or its machine stops, at any step of its writes: acknowledged changes are kept and the job
// ends with the same result.
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
  // The changes that the coordinator acknowledged.
  struct Told {
    bool accepted = false;
    std::set<std::string> done;  // tasks with acknowledged results
  };

  MachineFailureTest() {
    planner_.exchange = true;
    job_ = AJob(2);
    job_.request.id = "night";
  }

  // False if the machine stopped meanwhile. `durable_wait_s`: DispatchOptions::durable_wait_s.
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

  // Repeats a call while it is UNAVAILABLE, until the disk stops. Returns whether it returned OK.
  static bool IsTold(const ForgetfulDisk& disk, const std::function<Status()>& call) {
    Status status = call();
    while (absl::IsUnavailable(status) && !disk.stopped()) status = call();
    return status.ok();
  }
  // Runs the job to its end, or until the machine stops.
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
        clock_.Advance(10);  // a task whose lease was not stored in time is retried
        coordinator_->Tick().IgnoreError();
        continue;
      }
      if (!IsTold(disk, [&] { return Succeed(worker, *lease); })) return told;
      told.done.insert(lease->task);
    }
  }

  // Stops at the step, restarts and runs the job to its end. False if the job ended before that step.
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
      EXPECT_EQ(tasks->at(0).task.state, TaskState::kSucceeded) << task << " was acknowledged";
    }
  }
  void GoOn() {
    ASSERT_EQ(Create(job_), "jobs/1");
    clock_.Advance(31);  // all leases expire
    ASSERT_TRUE(coordinator_->Tick().ok());
    WorkAll(Worker());
    const JobStatus ended = Job("jobs/1");
    ASSERT_EQ(ended.header.state, JobState::kSucceeded);
    if (!mesh_) mesh_ = ended.artifacts.at(0).digest;
    EXPECT_EQ(ended.artifacts.at(0).digest, *mesh_);
  }

  Random random_{1};
  NewJob job_;
  std::optional<Digest> mesh_;  // of the first run
  int lives_ = 0;
  std::string path_;
  std::unique_ptr<SqliteStore> sqlite_;
};

TEST_F(MachineFailureTest, NoStepLosesAcknowledgedChanges) {
  for (const Left left : {Left::kNothing, Left::kFirst, Left::kAnything, Left::kAll}) {
    int64_t step = 1;
    while (StopsAt(step, left) && !HasFailure()) ++step;
    EXPECT_GT(step, 50);
    if (HasFailure()) return;
  }
}

}  // namespace
}  // namespace tessera
