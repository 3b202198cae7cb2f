// Stored results that rot, are cut or vanish: made again where somebody needs them, in the same job, to the same bytes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "tessera/v1/records.pb.h"
#include "tests/support/fake_coordinator.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

enum class Damage { kFlip, kCut, kDelete };
constexpr Damage kDamages[] = {Damage::kFlip, Damage::kCut, Damage::kDelete};

// ingest, a solve a tile, publish; an update takes surveys and states from its base (given), and solves from these.
class BasePlanner : public FakePlanner {
 public:
  StatusOr<std::vector<PlannedTask>> Update(const JobSettings&, const std::vector<NamedDigest>&,
                                            const UpdateBase& base) override {
    PlannedTask taken{kBaseKind, "base", -1, "", 1, {}}, update{kUpdateKind, "update", -1, "{}", 1, {}};
    taken.given = {{kBaseSurveyFile, base.survey}, {kCityFile, base.city}};
    for (size_t t = 0; t < base.states.size(); ++t) {
      taken.given.push_back({TileInputName(static_cast<int>(t), kStateFile), base.states[t]});
    }
    taken.given_contents = {{"files.json", "files, and " + base.survey_json}};
    update.inputs = {{TaskId(0), kBaseSurveyFile}, {TaskId(0), kCityFile}, {TaskId(0), "files.json"}};
    return std::vector<PlannedTask>{taken, update};
  }
  StatusOr<std::vector<PlannedTask>> Tiles(const JobSettings& settings, const std::string&,
                                           const std::vector<std::string>&, const UpdateBase* base) override {
    const int survey = base == nullptr ? 0 : 1;
    std::vector<PlannedTask> tasks;
    PlannedTask publish{kPublishKind, "publish", -1, "", 1, {}};
    publish.inputs = {{TaskId(survey), kCityFile}, {TaskId(survey), kPlainSurveyFile}};
    PublishParameters parameters;
    for (int t = 0; t < settings.tiles; ++t) {
      tasks.push_back(
          {"solve", "solve tile " + std::to_string(t), t, std::to_string(t), 1, {{TaskId(survey), kCityFile}}});
      if (base != nullptr) tasks.back().inputs.push_back({TaskId(0), TileInputName(t, kStateFile)});
      publish.inputs.push_back({TaskId(survey + 1 + t), kStateFile, t});
      parameters.tiles.push_back({t, {t, 0, t + 1, 1}});
    }
    publish.parameters = ToJson(parameters);
    tasks.push_back(publish);
    return tasks;
  }
};

class LostResultsTest : public CoordinatorTest {
 protected:
  LostResultsTest() {
    EXPECT_TRUE(WriteFileAtomic(folder_.path() + "/scene.json", "{}").ok());
    Open(&planner_);
  }
  void Open(Planner* planner) {
    dispatcher_.reset();
    dispatcher_ = *Dispatcher::Open({&store_, blobs_.get(), planner, &clock_, {}}, DispatchOptions());
  }
  NewJob Scene(int tiles, const std::string& base = "") {
    NewJob job = AJob(tiles);
    job.scene_path = folder_.path();
    job.settings.update.base = base;
    return job;
  }

  void Harm(const std::string& path, Damage damage) {
    if (damage == Damage::kDelete) {
      fs::remove(path);
    } else if (damage == Damage::kCut) {
      fs::resize_file(path, fs::file_size(path) - 1);
    } else {
      std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
      file.put('~');
    }
  }
  // Every blob that there is, by path; job.json, which is called otherwise every time, is the last.
  std::vector<std::string> Blobs() {
    std::vector<std::string> paths;
    const std::vector<std::string> names = *ListFiles(blobs_->root());
    for (const std::string& name : names) {
      if (name.rfind("set_aside", 0) != 0 && name.rfind("partial", 0) != 0)
        paths.push_back(blobs_->root() + "/" + name);
    }
    std::stable_partition(paths.begin(), paths.end(), [](const std::string& path) {
      return ReadFile(path).value_or("").find("\"tessera_job\"") == std::string::npos;
    });
    return paths;
  }

  // What a task of either planner makes of its inputs.
  ReportedResult Made(const GrantedLease& lease) {
    if (lease.plan.kind != "solve" && lease.plan.kind != kUpdateKind && !(lease.plan.kind == "ingest" && based_) &&
        !(lease.plan.kind == kPublishKind && based_)) {
      return Result(lease);
    }
    ReportedResult result;
    const auto add = [&](const std::string& name) {
      result.outputs.push_back({name, *blobs_->PutBytes(name + " of " + lease.plan.name + lease.key)});
    };
    if (lease.plan.kind == "solve") {
      add(kStateFile);
    } else if (lease.plan.kind == kPublishKind) {
      add("mesh.ply");
    } else {
      for (const char* name : {kSurveyFile, kPlainSurveyFile, kCityFile}) add(name);
    }
    return result;
  }
  // A worker's turn: it hashes its inputs, and tells those that it cannot have; else the task succeeds. False if there
  // was nothing to do.
  bool Turn(const std::string& worker) {
    const auto lease = Lease(worker);
    if (!lease) return false;
    TaskFailure lost{ErrorClass::kLostInput, "lost"};
    for (const LeasedInput& input : lease->inputs) {
      const auto found = HashFile(input.path);
      if (!found.ok() || *found != input.file.digest) lost.lost_inputs.push_back(input.file.digest);
    }
    const Status told = lost.lost_inputs.empty()
                            ? dispatcher_->ReportSuccess(worker, lease->task, lease->attempt, Made(*lease))
                            : dispatcher_->ReportFailure(worker, lease->task, lease->attempt, lost);
    EXPECT_TRUE(told.ok()) << told;
    return true;
  }
  // Turns until the job has ended, or nothing goes on.
  void Work(const std::string& job) {
    const std::string worker = Worker();
    for (int turns = 0; turns < 200 && !HasEnded(Job(job).header.state); ++turns) {
      if (Turn(worker)) continue;
      clock_.Advance(1);
      EXPECT_TRUE(dispatcher_->Tick().ok());
      if (turns > 100) break;
    }
  }
  Digest Mesh(const std::string& job) {
    const JobStatus status = Job(job);
    EXPECT_EQ(status.header.state, JobState::kSucceeded) << status.header.error;
    return status.header.artifacts.empty() ? Digest() : status.header.artifacts.front().digest;
  }

  bool based_ = false;
  BasePlanner base_planner_;
};

// Each stored file in turn, in each way, after each number of tasks; in half of all cases the coordinator is killed
// right after it.
TEST_F(LostResultsTest, WhateverIsLostWheneverTheJobEndsWithTheSameBytes) {
  planner_.exchange = true;
  Digest expected;
  int cases = 0, remade = 0;
  for (int turns = 0; turns <= 6; ++turns) {
    for (size_t file = 0;; ++file) {
      bool any = false;
      for (const Damage damage : kDamages) {
        ++cases;
        for (const std::string& path : Blobs()) fs::remove(path);
        dispatcher_.reset();
        store_.records.clear();
        Restart();
        const std::string job = Create(Scene(2)), worker = Worker();
        for (int i = 0; i < turns; ++i) ASSERT_TRUE(Turn(worker));
        const std::vector<std::string> blobs = Blobs();
        if (file >= blobs.size()) break;
        any = true;
        Harm(blobs[file], damage);
        if (cases % 2 == 0) Restart();
        Work(job);
        const Digest mesh = Mesh(job);
        if (expected.sha256.empty()) expected = mesh;
        ASSERT_EQ(mesh, expected) << turns << " " << blobs[file];
        // The same scene again finds what is left, and has the rest made.
        const std::string again = Create(Scene(2));
        Work(again);
        ASSERT_EQ(Mesh(again), expected) << turns << " " << blobs[file];
        // What is fetched is made again as well.
        if (!blobs_->Verify(mesh).ok()) {
          ASSERT_TRUE(dispatcher_->RemakeArtifact(mesh).ok());
          const std::string other = Worker();
          while (Turn(other)) {
          }
          ++remade;
        }
        ASSERT_TRUE(blobs_->Verify(mesh).ok());
        ASSERT_EQ(Job(job).header.state, JobState::kSucceeded);
      }
      if (!any) break;
    }
  }
  EXPECT_GT(cases, 60);
  EXPECT_GT(remade, 0);
}

TEST_F(LostResultsTest, AnUpdateHasTheResultsOfItsBaseMadeAgain) {
  based_ = true;
  Digest expected;
  for (const int turns : {0, 1, 2}) {
    for (size_t file = 0; file < 7; ++file) {
      for (const Damage damage : kDamages) {
        for (const std::string& path : Blobs()) fs::remove(path);
        dispatcher_.reset();
        store_.records.clear();
        Open(&base_planner_);
        const std::string base = Create(Scene(2));
        Work(base);
        const JobStatus before = Job(base);
        ASSERT_EQ(before.header.state, JobState::kSucceeded) << before.header.error;
        std::string update, worker = Worker();
        if (turns > 0) update = Create(Scene(2, base));
        for (int i = 1; i < turns; ++i) ASSERT_TRUE(Turn(worker));
        const std::vector<std::string> blobs = Blobs();
        ASSERT_LT(file, blobs.size());
        Harm(blobs[file], damage);
        if (turns == 0) update = Create(Scene(2, base));
        if (file % 2 == 0) Open(&base_planner_);
        Work(update);
        const Digest mesh = Mesh(update);
        if (expected.sha256.empty()) expected = mesh;
        ASSERT_EQ(mesh, expected);
        EXPECT_EQ(Job(base).header.state, JobState::kSucceeded);
        EXPECT_EQ(Job(base).header.end_us, before.header.end_us);
        EXPECT_EQ(Job(base).tasks_done, before.tasks_done);
      }
    }
  }
}

TEST_F(LostResultsTest, WhoReadsWhatItsBaseMakesAgainWaitsAndMayBeTriedAgain) {
  based_ = true;
  Open(&base_planner_);
  const std::string base = Create(Scene(1));
  Work(base);
  const std::string update = Create(Scene(1, base)), workers[] = {Worker(), Worker()};
  ASSERT_TRUE(Turn(workers[0]));
  fs::remove(blobs_->Path(Task(base, 1).task.outputs.at(0).digest));
  ASSERT_TRUE(Turn(workers[0]));  // tells that it is lost
  int remakes = 0;
  for (int turn = 0; turn < 20 && !HasEnded(Job(update).header.state); ++turn, clock_.Advance(20)) {
    const auto lease = Lease(workers[turn % 2]);
    if (!lease) continue;
    ASSERT_EQ(lease->task, base + "/tasks/1");
    EXPECT_FALSE(Lease(workers[1 - turn % 2])) << "who reads it waits";
    ReportedResult result = Made(*lease);
    result.outputs[0].digest = *blobs_->PutBytes("other bytes");
    ASSERT_TRUE(dispatcher_->ReportSuccess(workers[turn % 2], lease->task, lease->attempt, result).ok());
    ++remakes;
  }
  EXPECT_GT(remakes, 1);
  EXPECT_EQ(Job(update).header.state, JobState::kFailed);
  EXPECT_THAT(Job(update).header.error, HasSubstr("cannot be made again"));
  ASSERT_TRUE(dispatcher_->RetryJob(update, {}).ok());
  Open(&base_planner_);  // the records tell the same
  EXPECT_EQ(Job(update).header.state, JobState::kRunning);
  Work(update);
  EXPECT_EQ(Job(update).header.state, JobState::kSucceeded) << Job(update).header.error;
  EXPECT_EQ(Job(update).tasks_done, Job(update).tasks_total);
}

TEST_F(LostResultsTest, ARemakeWithOtherBytesIsToldAndRefused) {
  const std::string job = Create(Scene(1)), worker = Worker();
  ASSERT_TRUE(Turn(worker));
  fs::remove(blobs_->Path(Task(job, 0).task.outputs[1].digest));
  ASSERT_TRUE(Turn(worker));
  for (int i = 0; i < 10 && !HasEnded(Job(job).header.state); ++i) {
    const auto lease = Lease(worker);
    if (lease) {
      ASSERT_EQ(lease->plan.kind, "ingest") << "who reads it waits";
      ReportedResult result = Result(*lease);
      result.outputs[1].digest = *blobs_->PutBytes("other bytes");
      ASSERT_TRUE(dispatcher_->ReportSuccess(worker, lease->task, lease->attempt, result).ok());
    }
    clock_.Advance(20);
  }
  EXPECT_EQ(Job(job).header.state, JobState::kFailed);
  EXPECT_THAT(Job(job).header.error, AllOf(HasSubstr("was made again, and is not what it was"),
                                           HasSubstr("output mesh"), HasSubstr(Sha256Hex("other bytes"))));
}

TEST_F(LostResultsTest, AFolderThatEatsFilesFailsTheJobInTheEnd) {
  const std::string job = Create(Scene(1)), worker = Worker();
  int turns = 0;
  for (; turns < 100 && !HasEnded(Job(job).header.state); ++turns) {
    if (!Turn(worker)) break;
    for (const NamedDigest& output : Task(job, 0).task.outputs) {
      if (output.name == "mesh") fs::remove(blobs_->Path(output.digest));
    }
  }
  EXPECT_EQ(Job(job).header.state, JobState::kFailed);
  EXPECT_EQ(Task(job, 0).task.remakes, 5);
  EXPECT_THAT(Job(job).header.error, AllOf(HasSubstr("made again 5 times by 'read the scene' of jobs/1 and lost every"),
                                           HasSubstr(blobs_->root())));
}

TEST_F(LostResultsTest, ASceneFileThatChangedIsNamed) {
  const std::string job = Create(Scene(1)), worker = Worker();
  ASSERT_TRUE(WriteFileAtomic(folder_.path() + "/scene.json", "[]").ok());
  ASSERT_TRUE(Turn(worker));
  EXPECT_EQ(Job(job).header.state, JobState::kFailed);
  EXPECT_THAT(Job(job).header.error, AllOf(HasSubstr("the scene's file scene.json is not what it was"),
                                           HasSubstr(folder_.path() + "/scene.json was changed after")));
}

// A worker whose view of the files is wrong, or who says what is not so, has nothing made again.
TEST_F(LostResultsTest, WhatIsWholeIsNotMadeAgain) {
  const std::string job = Create(Scene(1)), worker = Worker();
  ASSERT_TRUE(Turn(worker));
  const Digest mesh = Task(job, 0).task.outputs[1].digest, survey = Task(job, 0).task.outputs[0].digest;
  fs::remove(blobs_->Path(survey));  // is no input of the task
  for (int i = 0; i < 10; ++i) {
    const auto lease = Lease(worker);
    ASSERT_TRUE(lease) << i;
    ASSERT_TRUE(
        dispatcher_
            ->ReportFailure(worker, lease->task, lease->attempt, {ErrorClass::kLostInput, "not there", {mesh, survey}})
            .ok());
    EXPECT_EQ(Task(job, 0).task.remakes, 0);
    EXPECT_FALSE(Lease(worker)) << "it waits";
    clock_.Advance(61);
  }
  EXPECT_EQ(Job(job).header.state, JobState::kRunning) << "it says nothing about the task";
}

}  // namespace
}  // namespace tessera
