// Jobs that go on from others, and workers that hash what they read and tell what they cannot have.
#pragma once

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/support/fake_coordinator.h"

namespace tessera {

// ingest, a solve a tile, publish; an update takes surveys and states from its base (given), and solves from these.
class BasePlanner : public FakePlanner {
 public:
  StatusOr<std::vector<PlannedTask>> Update(const JobSettings&, const std::vector<NamedDigest>&,
                                            const UpdateBase& base) override {
    PlannedTask taken{kBaseKind, "base", -1, "", 1, {}}, update{kUpdateKind, "update", -1, "{}", 1, {}};
    taken.given.Edit() = {{kBaseSurveyFile, base.survey}, {kCityFile, base.city}};
    for (size_t t = 0; t < base.states.size(); ++t) {
      taken.given.Edit().push_back({TileInputName(static_cast<int>(t), kStateFile), base.states[t]});
    }
    taken.given_contents.Edit() = {{"files.json", "files, and " + base.survey_json}};
    update.inputs = {{TaskId(0), kBaseSurveyFile}, {TaskId(0), kCityFile}, {TaskId(0), "files.json"}};
    return std::vector<PlannedTask>{taken, update};
  }
  StatusOr<std::vector<PlannedTask>> Tiles(const JobSettings& settings, const std::string&,
                                           const std::vector<std::string>&, const UpdateBase* base,
                                           const FinePart*) override {
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

// Jobs of either planner, and workers that check what they read.
class CheckingWorkerTest : public CoordinatorTest {
 protected:
  CheckingWorkerTest() {
    EXPECT_TRUE(WriteFileAtomic(folder_.path() + "/scene.json", "{}").ok());
    Open(&planner_);
  }
  void Open(Planner* planner) {
    coordinator_.reset();
    coordinator_ = *Coordinator::Open({&store_, blobs_.get(), planner, &clock_, {}}, options_);
  }
  NewJob Scene(int tiles, const std::string& base = "") {
    NewJob job = AJob(tiles);
    job.scene_path = folder_.path();
    job.settings.update.base = base;
    return job;
  }

  // Every blob that there is, by path; job.json, which is called otherwise every time, is the last.
  std::vector<std::string> Blobs() {
    std::vector<std::string> paths;
    const std::vector<std::string> names = *ListFiles(blobs_->root());
    for (const std::string& name : names) {
      if (name.rfind("quarantined", 0) != 0 && name.rfind("partial", 0) != 0)
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
  // A worker's turn: it hashes its inputs, and tells those that it cannot have; else the task succeeds, or fails as
  // `fails_` says. False if there was nothing to do.
  bool Turn(const std::string& worker) {
    const auto lease = Lease(worker);
    if (!lease) return false;
    TaskFailure lost{ErrorClass::kLostInput, "lost"};
    for (const LeasedInput& input : lease->inputs) {
      const auto found = HashFile(input.path);
      if (!found.ok() || *found != input.file.digest) lost.lost_inputs.push_back(input.file.digest);
    }
    if (lost.lost_inputs.empty() && lease->plan.kind == fails_) lost = {ErrorClass::kInput, "it broke"};
    const Status told = lost.error_class == ErrorClass::kLostInput && lost.lost_inputs.empty()
                            ? ReportSuccessAndWait(*coordinator_, worker, lease->task, lease->attempt, Made(*lease))
                            : ReportFailureAndWait(*coordinator_, worker, lease->task, lease->attempt, lost);
    EXPECT_TRUE(told.ok()) << told;
    return true;
  }
  // Turns until the job has ended, or nothing goes on.
  void Work(const std::string& job) {
    const std::string worker = Worker();
    for (int turns = 0; turns < 200 && !HasEnded(Job(job).header.state); ++turns) {
      if (Turn(worker)) continue;
      clock_.Advance(1);
      EXPECT_TRUE(coordinator_->Tick().ok());
      if (turns > 100) break;
    }
  }
  Digest Mesh(const std::string& job) {
    const JobStatus status = Job(job);
    EXPECT_EQ(status.header.state, JobState::kSucceeded) << status.header.error;
    return status.artifacts.empty() ? Digest() : status.artifacts.front().digest;
  }

  bool based_ = false;
  std::string fails_;  // the kind of tasks that fail for good
  BasePlanner base_planner_;
};

}  // namespace tessera
