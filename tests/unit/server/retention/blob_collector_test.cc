// The collector removes unreferenced blobs and never a referenced one, even if jobs change during a pass.
#include "server/retention/blob_collector.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <random>
#include <set>

#include "server/retention/verify_state.h"
#include "tests/support/checking_worker.h"

namespace tessera {
namespace {

using testing::_;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::IsSubsetOf;
using testing::SizeIs;

constexpr double kLook_s = 1200, kYears_s = 20 * 365 * 86400.0;

class BlobCollectorTest : public CheckingWorkerTest {
 protected:
  BlobCollectorTest() {
    planner_.exchange = true;
    options_.lease_s = options_.stall_s = options_.forget_worker_s = 1e9;
    clock_.SetBy(kYears_s);  // every file is old
    Restart();
    reclaimer_ = std::make_unique<Reclaimer>(coordinator_->core());
    collector_ = std::make_unique<BlobCollector>(reclaimer_.get(), blobs_.get(), &clock_, CollectorOptions());
  }
  Collected Look(double pass_s = kLook_s) {
    clock_.Advance(pass_s);
    const auto collected = collector_->Pass();
    EXPECT_TRUE(collected.ok()) << collected.status();
    return collected.value_or(Collected());
  }
  void LookLong() {
    for (double passed_s = 0; passed_s <= 3600; passed_s += kLook_s) Look();
  }
  void Limit(int64_t bytes, double keep_quarantined_s = 0) {
    CollectorOptions options;
    options.limit_bytes = bytes;
    options.keep_quarantined_s = keep_quarantined_s;
    reclaimer_ = std::make_unique<Reclaimer>(coordinator_->core());
    collector_ = std::make_unique<BlobCollector>(reclaimer_.get(), blobs_.get(), &clock_, options);
  }
  void RestartAll() {
    Restart();
    Limit(limit_bytes_);
  }
  std::set<std::string> Stored() {
    const auto names = ListFiles(blobs_->root());
    EXPECT_TRUE(names.ok()) << names.status();
    return {names->begin(), names->end()};
  }
  // Faults in the stored state.
  std::vector<std::string> Faults() {
    std::vector<std::string> faults;
    // VerifyState reads the store, so all records must be durable.
    EXPECT_TRUE(coordinator_->core().Durable().ok());
    EXPECT_TRUE(VerifyState(store_, *blobs_, true, [&](const std::string& fault) { faults.push_back(fault); }).ok());
    std::erase_if(faults, [&](const std::string& fault) {
      return std::any_of(spared_.begin(), spared_.end(), [&](const std::string& sha256) {
        return fault.find("no blob " + sha256) != std::string::npos;
      });
    });
    return faults;
  }
  // Outputs of active jobs that are not stored.
  std::set<std::string> MissingOfActive() {
    std::set<std::string> missing;
    for (const JobStatus& job : coordinator_->jobs().ListJobs(-1, 1000)) {
      if (HasEnded(job.header.state)) continue;
      const auto tasks = coordinator_->jobs().ListTasks(job.header.name, 0, 1000);
      for (const TaskStatus& task : *tasks) {
        for (const StoredFile& output : task.task.outputs) {
          if (!blobs_->Has(output.digest())) missing.insert(output.sha256.Hex());
        }
      }
    }
    return missing;
  }

  int64_t limit_bytes_ = 0;
  std::set<std::string> spared_;  // blobs missing when their jobs were retried
  std::unique_ptr<Reclaimer> reclaimer_;
  std::unique_ptr<BlobCollector> collector_;
};

TEST_F(BlobCollectorTest, RemovesBlobsOfADeletedJobButNotSharedOnes) {
  const std::string first = Create(AJob(2));
  WorkAll(Worker());
  const std::string second = Create(AJob(2, "{\"other\":1}"));
  WorkAll(Worker());
  LookLong();
  EXPECT_THAT(Faults(), IsEmpty());
  const auto before = Stored();
  ASSERT_TRUE(coordinator_->jobs().DeleteJob(first, "").ok());
  Look();
  Look();
  EXPECT_EQ(Stored(), before) << "the grace period has not passed";
  LookLong();
  EXPECT_LT(Stored().size(), before.size());
  EXPECT_THAT(Faults(), IsEmpty());
  ASSERT_TRUE(coordinator_->jobs().DeleteJob(second, "").ok());
  LookLong();
  EXPECT_THAT(Stored(), IsEmpty());
}

TEST_F(BlobCollectorTest, ClassifierStaysAsLongAsItsJob) {
  NewJob job = AJob(2);
  job.classifier = "what was learnt";
  job.settings.classifier = "/models/city.model";
  const Digest digest = {Sha256Hex(job.classifier), static_cast<int64_t>(job.classifier.size())};
  job.scene_files.push_back({kClassifierFile, digest});
  const std::string name = Create(job);
  LookLong();
  EXPECT_TRUE(blobs_->Has(digest)) << "before any task reads it";
  RestartAll();
  WorkAll(Worker());
  LookLong();
  EXPECT_TRUE(blobs_->Has(digest));
  EXPECT_THAT(Faults(), IsEmpty());
  ASSERT_EQ(std::remove(blobs_->LocalPath(digest)->c_str()), 0);
  EXPECT_THAT(Faults(), testing::Contains(testing::HasSubstr(kClassifierFile)));
  ASSERT_TRUE(coordinator_->jobs().DeleteJob(name, "").ok());
  LookLong();
  EXPECT_THAT(Stored(), IsEmpty());
}

TEST_F(BlobCollectorTest, RemovesLeftoversAfterADayButNoForeignFiles) {
  const std::string folder = blobs_->root() + "/ab/";
  ASSERT_TRUE(EnsureFolder(folder).ok());
  for (const std::string& path : {folder + std::string(64, 'a') + ".tmp-1", blobs_->root() + "/partial/put-1",
                                  folder + "notes", blobs_->root() + "/probe"}) {
    std::ofstream(path) << "x";
  }
  for (double passed_s = 0; passed_s < 80000; passed_s += 10000) Look(10000);
  EXPECT_THAT(Stored(), SizeIs(4));
  Look(20000);
  EXPECT_THAT(Stored(), ElementsAre("ab/notes", "probe"));
}

// A new file stays, even if passes found it unneeded for long.
TEST_F(BlobCollectorTest, NewFileStays) {
  clock_.SetBy(-kYears_s);
  clock_.SetBy(static_cast<double>(SystemClock().UnixTimeUs() - clock_.UnixTimeUs()) / 1e6);
  ASSERT_TRUE(blobs_->PutBytes("uploaded").ok());
  for (int look = 0; look < 5; ++look) {
    Look();
    clock_.SetBy(-kLook_s);
  }
  EXPECT_THAT(Stored(), SizeIs(1));
}

TEST_F(BlobCollectorTest, AboveTheLimitRemovesRecomputableBlobsOldestJobsFirst) {
  const std::string first = Create(AJob(2));
  WorkAll(Worker());
  clock_.Advance(10);
  const std::string second = Create(AJob(3, "{\"other\":1}"));
  WorkAll(Worker());
  const auto has_tiles = [&](const std::string& job) {
    int tiles = 0;
    const auto tasks = coordinator_->jobs().ListTasks(job, 0, 100);
    for (const TaskStatus& task : *tasks) {
      if (task.task.plan.kind == "cut") tiles += blobs_->Has(task.task.outputs[0].digest());
    }
    return tiles;
  };
  const int64_t all = Look().bytes_left;
  Limit(all);
  EXPECT_EQ(Look().files, 0);
  Limit(all - 1);
  EXPECT_EQ(Look().files, 1);
  EXPECT_EQ(has_tiles(first), 1);
  EXPECT_EQ(has_tiles(second), 3);
  Limit(1);
  Look();
  EXPECT_EQ(has_tiles(first), 0);
  EXPECT_EQ(has_tiles(second), 0);
  EXPECT_THAT(Faults(), IsEmpty());
  // Removed blobs are recomputed when needed.
  const std::string again = Create(AJob(2));
  EXPECT_GT(WorkAll(Worker()), 0);
  EXPECT_EQ(Job(again).header.state, JobState::kSucceeded);
}

// Another coordinator may have taken over, whose references this one does not know.
TEST_F(BlobCollectorTest, NothingIsRemovedWithoutTheRight) {
  bool may_remove = false;
  CollectorOptions options;
  options.keep = {blobs_->PutBytes("kept without a reference")->sha256};
  reclaimer_ = std::make_unique<Reclaimer>(coordinator_->core(), [&] { return may_remove; });
  collector_ = std::make_unique<BlobCollector>(reclaimer_.get(), blobs_.get(), &clock_, options);
  ASSERT_TRUE(blobs_->PutBytes("not needed").ok());
  const auto before = Stored();
  LookLong();
  EXPECT_EQ(Stored(), before);
  may_remove = true;
  LookLong();
  EXPECT_EQ(Stored().size(), before.size() - 1);
  EXPECT_TRUE(blobs_->Has({*options.keep.begin(), 24}));
}

// Between marking and removal a job may add a reference to an unneeded blob.
TEST_F(BlobCollectorTest, BlobWithANewReferenceStays) {
  const std::string first = Create(AJob(1));
  const std::string worker = Worker();
  const auto lease = Lease(worker);
  const ReportedResult result = Result(*lease);  // stored, and reported later
  std::vector<BlobEntry> doomed;
  const BlobReferences references = Reclaimer(coordinator_->core()).CollectReferences();
  for (int part = 0; part < BlobStore::kParts; ++part) {
    for (const auto entries = *blobs_->List(part); const BlobEntry& file : entries) {
      EXPECT_FALSE(references.Needs(BlobReferences::IdOf(file.sha256)));
      doomed.push_back(file);
    }
  }
  ASSERT_EQ(doomed.size(), 2u);
  ASSERT_TRUE(ReportSuccessAndWait(*coordinator_, worker, lease->task, lease->attempt, result).ok());
  EXPECT_THAT(*Reclaimer(coordinator_->core()).RemoveBlobs(doomed), IsEmpty());
  EXPECT_THAT(Faults(), IsEmpty());
}

TEST_F(BlobCollectorTest, BlobsOfARetriedJobStay) {
  fails_ = "refine";
  const std::string job = Create(Scene(2));
  Work(job);
  ASSERT_EQ(Job(job).header.state, JobState::kFailed);
  std::vector<BlobEntry> spare;
  const BlobReferences references = Reclaimer(coordinator_->core()).CollectReferences();
  for (int part = 0; part < BlobStore::kParts; ++part) {
    for (const auto entries = *blobs_->List(part); const BlobEntry& file : entries) {
      if (references.SpareSince(BlobReferences::IdOf(file.sha256)) >= 0) spare.push_back(file);
    }
  }
  ASSERT_EQ(spare.size(), 2u) << "the cuts of both tiles";
  ASSERT_TRUE(coordinator_->jobs().RetryJob(job, {}).ok());
  EXPECT_THAT(*Reclaimer(coordinator_->core()).RemoveBlobs(spare), IsEmpty());
  fails_ = "";
  Work(job);
  Mesh(job);
  EXPECT_EQ(Task(job, 1).task.remakes, 0);
}

// More rounds than max_remakes allows for a bad disk.
TEST_F(BlobCollectorTest, RetriedJobRecomputesMissingResults) {
  Limit(1);
  fails_ = "refine";
  const std::string job = Create(Scene(2));
  for (int round = 0; round < 2 + options_.retry.max_remakes; ++round) {
    Work(job);
    ASSERT_THAT(Job(job).header.error, HasSubstr("it broke")) << round;
    Look();
    ASSERT_FALSE(blobs_->Has(Task(job, 1).task.outputs[0].digest()));
    ASSERT_TRUE(coordinator_->jobs().RetryJob(job, {}).ok());
  }
  fails_ = "";
  Work(job);
  Mesh(job);
  EXPECT_THAT(Faults(), IsEmpty());
}

// An ended job that recomputes results for others needs all its blobs until it has finished.
TEST_F(BlobCollectorTest, RecomputedResultStaysUntilItIsRead) {
  const std::string job = Create(Scene(2)), worker = Worker();
  Work(job);
  Limit(1);
  Look();
  const Digest mesh = Mesh(job), tile = Task(job, 1).task.outputs[0].digest();
  EXPECT_FALSE(blobs_->Has(tile));
  for (const int task : {3, 4, 5})
    ASSERT_TRUE(RemoveTree(*blobs_->LocalPath(Task(job, task).task.outputs[0].digest())).ok());
  ASSERT_TRUE(coordinator_->recovery().RemakeArtifact(mesh).ok());
  for (int turns = 0; turns < 40 && Turn(worker); ++turns) Look();
  EXPECT_TRUE(blobs_->Verify(mesh).ok());
  for (const int task : {1, 2}) EXPECT_EQ(Task(job, task).task.remakes, 1);
  Look();
  EXPECT_FALSE(blobs_->Has(tile));
}

// Between marking and removal an ended job may be asked to recompute a result.
TEST_F(BlobCollectorTest, ResultThatAnEndedJobRecomputesStays) {
  const std::string job = Create(Scene(2)), worker = Worker();
  Work(job);
  const Digest mesh = Mesh(job), tile = Task(job, 1).task.outputs[0].digest();
  const BlobReferences references = Reclaimer(coordinator_->core()).CollectReferences();
  std::vector<BlobEntry> listed;
  for (int part = 0; part < BlobStore::kParts; ++part) {
    for (const auto entries = *blobs_->List(part); const BlobEntry& file : entries) {
      if (file.sha256 == tile.sha256) listed.push_back(file);
    }
  }
  ASSERT_TRUE(RemoveTree(*blobs_->LocalPath(mesh)).ok());
  ASSERT_TRUE(coordinator_->recovery().RemakeArtifact(mesh).ok());
  EXPECT_THAT(*Reclaimer(coordinator_->core()).RemoveBlobs(listed), IsEmpty());
}

TEST_F(BlobCollectorTest, QuarantinedBlobsExpireByAgeOrSpace) {
  const auto quarantined = [&](const std::string& content) {
    const Digest digest = *blobs_->PutBytes(content);
    std::ofstream(*blobs_->LocalPath(digest), std::ios::in | std::ios::out) << "~";
    EXPECT_EQ(blobs_->VerifyOrQuarantine(digest).code(), absl::StatusCode::kDataLoss);
    return digest.sha256;
  };
  quarantined("first");
  LookLong();
  LookLong();
  EXPECT_THAT(Stored(), SizeIs(1)) << "kept for ever by default";
  Limit(0, 86400);
  for (double passed_s = 0; passed_s < Retention::kConfirm_s; passed_s += kLook_s) Look();
  EXPECT_THAT(Stored(), SizeIs(1)) << "expiry is not confirmed yet";
  Look();
  EXPECT_THAT(Stored(), IsEmpty());
  quarantined("older");
  const std::string newer = quarantined("newer");
  Limit(6);
  Look();
  EXPECT_THAT(Stored(), ElementsAre(HasSubstr(newer)));
}

// Random steps of jobs, workers, restarts and the collector.
TEST_F(BlobCollectorTest, RandomStepsNeverRemoveANeededBlob) {
  options_.retry.max_input = 1;  // jobs fail immediately
  int retried = 0;
  for (const int seed : {1, 2, 3}) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    limit_bytes_ = seed == 3 ? 1 : 0;
    RestartAll();
    std::vector<std::pair<std::string, GrantedLease>> held;
    int64_t collected = 0;
    spared_.clear();
    for (int step = 0; step < 400; ++step) {
      const auto jobs = coordinator_->jobs().ListJobs(-1, 100);
      const auto any_job = [&] { return jobs[random() % jobs.size()].header.name; };
      switch (random() % 12) {
        case 0:
          if (jobs.size() < 6) Create(AJob(1 + static_cast<int>(random() % 3), std::to_string(random() % 6)));
          break;
        case 1:
        case 2:
        case 3:
        case 4: {
          const std::string worker = Worker();
          if (const auto lease = Lease(worker)) held.emplace_back(worker, *lease);
          break;
        }
        case 5:
        case 6:
        case 7:
          if (!held.empty()) {
            const auto [worker, lease] = held.front();
            held.erase(held.begin());
            const bool refines = lease.plan.kind == "refine";
            TaskFailure lost{ErrorClass::kLostInput, "lost"};
            for (const LeasedInput& input : lease.inputs) {
              if (refines && !blobs_->Has(input.file.digest)) lost.lost_inputs.push_back(input.file.digest);
            }
            // Refused for a cancelled or deleted job.
            if (!lost.lost_inputs.empty()) {
              ReportFailureAndWait(*coordinator_, worker, lease.task, lease.attempt, lost).IgnoreError();
            } else if (refines && random() % 4 == 0) {
              Fail(worker, lease, ErrorClass::kInput).IgnoreError();
            } else {
              Succeed(worker, lease).IgnoreError();
            }
          }
          break;
        case 8:
          if (!jobs.empty()) {
            const std::string job = any_job();
            if (random() % 8 == 0) coordinator_->jobs().CancelJob(job).IgnoreError();
            coordinator_->jobs().DeleteJob(job, "").IgnoreError();
          }
          break;
        case 9:
          if (random() % 8 == 0) {
            RestartAll();  // workers keep their leases
          } else if (!jobs.empty() && coordinator_->jobs().RetryJob(any_job(), {}).ok()) {
            ++retried;
            for (const std::string& sha256 : MissingOfActive()) spared_.insert(sha256);
          }
          break;
        case 10:
          if (!*Reclaimer(coordinator_->core()).FreeDeleted()) collected += Look(3600).files;
          break;
        default:
          collected += Look().files;
      }
      ASSERT_THAT(MissingOfActive(), IsSubsetOf(spared_)) << "step " << step;
      ASSERT_THAT(Faults(), IsEmpty()) << "step " << step;
    }
    EXPECT_GT(collected, 20);
    for (const JobStatus& job : coordinator_->jobs().ListJobs(-1, 100)) {
      ASSERT_TRUE(coordinator_->jobs().CancelJob(job.header.name).ok());
      ASSERT_TRUE(coordinator_->jobs().DeleteJob(job.header.name, "").ok());
    }
    LookLong();
    EXPECT_THAT(Stored(), IsEmpty());
  }
  EXPECT_GT(retried, 5);
}

TEST_F(BlobCollectorTest, VerifyStateReportsFaults) {
  Create(AJob(1));
  WorkAll(Worker());
  EXPECT_THAT(Faults(), IsEmpty());
  const auto outputs = Task("jobs/1", 0).task.outputs;
  std::ofstream(*blobs_->LocalPath(outputs[0].digest()), std::ios::in | std::ios::out) << "X";
  ASSERT_TRUE(RemoveTree(*blobs_->LocalPath(outputs[1].digest())).ok());
  store_.records.push_back("no record");
  const auto shallow = VerifyState(store_, *blobs_, false, [](const std::string&) {});
  EXPECT_EQ(shallow->faults, 2) << "does not read contents";
  EXPECT_EQ(shallow->jobs, 1);
  const std::string survey = "jobs/1, 'read the scene', survey.json: ";
  const auto mesh_is_gone = HasSubstr("jobs/1, 'read the scene', mesh: no blob");
  EXPECT_THAT(Faults(),
              ElementsAre(HasSubstr("record " + std::to_string(store_.records.size()) + ": cannot parse the record"),
                          AllOf(HasSubstr(survey + "blob " + outputs[0].digest().sha256 + " was damaged (found 6"),
                                HasSubstr(Sha256Hex("Xurvey") + ", expected 6"), HasSubstr("/quarantine/")),
                          mesh_is_gone));
  EXPECT_THAT(Faults(), ElementsAre(_, HasSubstr(survey + "no blob"), mesh_is_gone)) << "quarantined";
}

}  // namespace
}  // namespace tessera
