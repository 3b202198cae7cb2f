// Replaying the records restores the state exactly.
#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <sstream>

#include "common/base/random.h"
#include "common/base/refusal.h"
#include "common/base/version.h"
#include "server/ledger/check_record.h"
#include "server/ledger/ledger.h"
#include "server/ledger/task_inputs.h"
#include "tessera/v1/records.pb.h"
#include "tests/support/fake_coordinator.h"

namespace tessera {
namespace {

template <class Files>
std::string Text(const Files& files) {
  std::string text;
  for (const auto& each : files) {
    const NamedDigest& file = each;
    text += file.name + ":" + file.digest.sha256 + " ";
  }
  return text;
}

// The ledger's jobs as text.
std::string Text(const Ledger& ledger) {
  std::ostringstream out;
  for (const Job& job : ledger.jobs()) {
    const JobHeader& header = job.header;
    out << header.name << " " << static_cast<int>(header.state) << " " << header.error << " " << header.create_us << " "
        << header.start_us << " " << header.end_us << " " << job.lost << job.unfinished << " " << Text(job.artifacts)
        << Text(job.scene_files) << "\n";
    for (const JobTask& task : job.tasks) {
      out << task.plan.name << " " << static_cast<int>(task.state) << " " << task.key_hex() << " "
          << task.retry_delay_us << " " << task.error->message << " " << task.reused << task.stats
          << task.usage.core_seconds << " " << task.usage.peak_bytes << " " << task.remakes << task.remaking
          << task.missing << Text(task.outputs) << task.start_us << " " << task.end_us;
      for (const Attempt& attempt : task.attempts) {
        out << " [" << attempt.worker << " " << attempt.start_us << " " << attempt.end_us << " "
            << static_cast<int>(attempt.failure->error_class) << attempt.lease_expired << "]";
      }
      out << "\n";
    }
  }
  for (const int job : ledger.active_jobs()) out << job << " ";
  return out.str();
}

class ReplayTest : public CoordinatorTest {
 protected:
  // A random action of a worker or user.
  void RandomStep(Random& random, std::vector<std::string>& workers,
                  std::vector<std::pair<std::string, GrantedLease>>& leases) {
    switch (random.Below(12)) {
      case 0:
        if (random.Below(4) == 0)
          Create(AJob(static_cast<int>(random.Below(4)) + 1, "scene " + std::to_string(random.Below(3))));
        break;
      case 1:
        workers.push_back(Worker());
        break;
      case 2:
        clock_.Advance(random.Uniform(0, 20));
        EXPECT_TRUE(coordinator_->Tick().ok());
        break;
      case 3:
        if (random.Below(20) == 0) {
          coordinator_->jobs().CancelJob("jobs/" + std::to_string(random.Below(5) + 1)).status().IgnoreError();
        }
        break;
      case 4: {
        if (leases.empty()) break;
        const auto& [worker, lease] =
            leases[leases.size() - 1 -
                   static_cast<size_t>(random.Below(std::min<int64_t>(20, static_cast<int64_t>(leases.size()))))];
        if (random.Below(3) == 0)
          Fail(worker, lease,
               random.Below(8) == 0   ? ErrorClass::kInput
               : random.Below(2) == 0 ? ErrorClass::kTransient
                                      : ErrorClass::kPreempted)
              .IgnoreError();
        break;
      }
      case 5:
      case 6: {
        if (leases.empty()) break;
        const auto& [worker, lease] =
            leases[leases.size() - 1 -
                   static_cast<size_t>(random.Below(std::min<int64_t>(3, static_cast<int64_t>(leases.size()))))];
        Succeed(worker, lease).IgnoreError();
        break;
      }
      case 7: {  // a worker reports a lost input
        if (leases.empty()) break;
        const auto& [worker, lease] =
            leases[leases.size() - 1 -
                   static_cast<size_t>(random.Below(std::min<int64_t>(3, static_cast<int64_t>(leases.size()))))];
        if (lease.plan.inputs.empty()) break;
        const Digest digest =
            lease.inputs[static_cast<size_t>(random.Below(static_cast<int64_t>(lease.plan.inputs.size())))].file.digest;
        if (random.Below(4) == 0) std::filesystem::remove(*blobs_->LocalPath(digest));
        ReportFailureAndWait(*coordinator_, worker, lease.task, lease.attempt,
                             {ErrorClass::kLostInput, "gone", {digest}})
            .IgnoreError();
        break;
      }
      default: {
        if (workers.empty()) break;
        std::string& worker = workers[static_cast<size_t>(random.Below(static_cast<int64_t>(workers.size())))];
        const auto lease = LeaseAndWait(*coordinator_, worker, 0, {});
        if (RefusalOf(lease.status()) == Refusal::kUnknownWorker) worker = Worker();  // after a restart
        if (lease.ok() && *lease) leases.emplace_back(worker, **lease);
      }
    }
  }
};

TEST_F(ReplayTest, EveryPrefixOfTheRecordsGivesItsState) {
  std::map<std::string, int> attempts;  // by task: numbers grow by one
  Ledger live(kAlgorithmVersion);
  std::vector<std::string> states = {Text(live)};
  coordinator_.reset();
  const auto observe = [&](const v1::Record& record, const ChangedTask&) {
    if (record.has_attempt_started()) {
      EXPECT_EQ(record.attempt_started().attempt(), ++attempts[record.attempt_started().task()]);
    }
    EXPECT_TRUE(CheckRecord(live, record).ok());
    live.Apply(record);
    states.push_back(Text(live));
  };
  Random random(7);
  std::vector<std::string> workers;
  std::vector<std::pair<std::string, GrantedLease>> leases;
  int succeeded = 0;
  for (int restart = 0; restart < 12; ++restart) {
    planner_.exchange = restart % 2 == 1;
    coordinator_.reset();  // stores the remaining records
    auto coordinator = Coordinator::Open({&store_, blobs_.get(), &planner_, &clock_, observe}, DispatchOptions());
    ASSERT_TRUE(coordinator.ok()) << coordinator.status();
    coordinator_ = *std::move(coordinator);
    for (int step = 0; step < 60; ++step) RandomStep(random, workers, leases);
  }
  for (const JobStatus& job : coordinator_->jobs().ListJobs(-1, 1000)) {
    if (job.header.state == JobState::kSucceeded) ++succeeded;
  }
  EXPECT_GT(succeeded, 3);  // the random walk made progress
  coordinator_.reset();     // stores the remaining records
  ASSERT_EQ(states.size(), store_.records.size() + 1);
  ASSERT_GT(store_.records.size(), 100u);

  Ledger replayed(kAlgorithmVersion);
  for (size_t i = 0; i < store_.records.size(); ++i) {
    v1::Record record;
    ASSERT_TRUE(record.ParseFromString(store_.records[i]));
    ASSERT_TRUE(CheckRecord(replayed, record).ok()) << i;
    replayed.Apply(record);
    ASSERT_EQ(Text(replayed), states[i + 1]) << "record " << i;
  }
}

// A job continues from any prefix of the records to the same result.
TEST_F(ReplayTest, AnyPrefixCanBeFinished) {
  planner_.exchange = true;
  const std::string job = Create(AJob(2));
  WorkAll(Worker());
  const NamedDigest mesh = Job(job).artifacts.at(0);
  const std::vector<std::string> all = store_.records;
  for (size_t size = 1; size <= all.size(); ++size) {
    store_.records.assign(all.begin(), all.begin() + static_cast<int64_t>(size));
    Restart();
    ASSERT_TRUE(coordinator_->Tick().ok());
    clock_.Advance(31);  // all leases expire
    ASSERT_TRUE(coordinator_->Tick().ok());
    WorkAll(Worker());
    EXPECT_EQ(Job(job).header.state, JobState::kSucceeded) << "after " << size << " records";
    EXPECT_EQ(Job(job).artifacts.at(0), mesh);
  }
}

TEST(TaskKeyTest, DependsOnAllInputsButNotOnTheirOrder) {
  const NamedDigest a{"a", {std::string(64, '1'), 1}}, b{"b", {std::string(64, '2'), 2}};
  const std::string key = TaskKey("1", "cut", "{}", {a, b});
  EXPECT_EQ(key, TaskKey("1", "cut", "{}", {b, a}));
  EXPECT_NE(key, TaskKey("2", "cut", "{}", {a, b}));
  EXPECT_NE(key, TaskKey("1", "refine", "{}", {a, b}));
  EXPECT_NE(key, TaskKey("1", "cut", "{\"x\":1}", {a, b}));
  EXPECT_NE(key, TaskKey("1", "cut", "{}", {a}));
  EXPECT_NE(key, TaskKey("1", "cut", "{}", {{"a", b.digest}, {"b", a.digest}}));
}

TEST(NamesTest, RoundTripAndRefuseMalformedNames) {
  EXPECT_EQ(*ParseTaskName(TaskName({4, 12})), (TaskRef{4, 12}));
  EXPECT_EQ(*ParseJobName(JobName(0)), 0);
  for (const char* name :
       {"", "jobs/", "jobs/0", "jobs/01", "jobs/-1", "jobs/1/tasks/", "jobs/x", "jobs/12345678901"}) {
    EXPECT_FALSE(ParseJobName(name).ok()) << name;
    EXPECT_FALSE(ParseTaskName(name).ok()) << name;
  }
}

// protobuf writes strings that are not UTF-8, but refuses to read them.
TEST_F(ReplayTest, MessagesWithInvalidUtf8CanBeStored) {
  NewJob job = AJob(1);
  job.warnings = {"image\xff.jpg: odd"};
  const std::string name = Create(job);
  Restart();
  EXPECT_TRUE(store_.quarantined.empty());
  EXPECT_EQ(Job(name).header.state, JobState::kQueued);
  EXPECT_EQ(Job(name).header.warnings.at(0), "image\\xff.jpg: odd");
}

}  // namespace
}  // namespace tessera
