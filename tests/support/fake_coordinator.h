// Fake dependencies of a coordinator: records in a vector, blobs in a temporary folder, a planner of small graphs and a
// clock that moves only when advanced.
#pragma once

#include <gtest/gtest.h>

#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"
#include "server/jobs/coordinator.h"
#include "tests/support/blocking_calls.h"
#include "tests/support/fake_clock.h"

namespace tessera {

// Its members are for while no coordinator writes.
class MemoryStore : public RecordStore {
 public:
  Status Append(const std::vector<std::string_view>& added, Durability) override {
    if (fail) return absl::ResourceExhaustedError("disk full");
    std::lock_guard lock(mutex_);
    records.insert(records.end(), added.begin(), added.end());
    return absl::OkStatus();
  }
  Status Replay(const std::function<void(const StoredRecord&)>& visit) override {
    ++starts;
    std::vector<std::string> stored;
    {
      std::lock_guard lock(mutex_);
      stored = records;
    }
    int64_t number = 0;
    for (const std::string& record : stored) {
      if (quarantined.contains(++number)) continue;
      visit({number, record == kDamaged ? StatusOr<std::string>(absl::DataLossError("damaged")) : record});
    }
    return absl::OkStatus();
  }
  Status Quarantine(int64_t number, const std::string& reason) override {
    quarantined[number] = reason;
    return absl::OkStatus();
  }
  StatusOr<std::set<int>> DeletedJobs() override { return std::set<int>(); }
  StatusOr<int> RemoveRecords(int) override { return 0; }
  int64_t StartCount() const override { return starts; }

  static constexpr char kDamaged[] = "damaged";  // in place of a record
  std::vector<std::string> records;
  std::map<int64_t, std::string> quarantined;  // reasons by number
  int64_t starts = 0;
  std::atomic<bool> fail = false;

 private:
  std::mutex mutex_;  // of `records`
};

// ingest -> `tiles` refine tasks (tile t costs t + 1) -> publish. The survey's text enters the refine tasks'
// parameters. Where tiles exchange: ingest; `tiles` cuts; refine tasks, each of which reads the cuts of the tiles that
// its own cut named under `sight` (but of those that are quarantined), and publish.
class FakePlanner : public Planner {
 public:
  bool exchange = false;

  StatusOr<std::vector<PlannedTask>> Ingest(const JobSettings& settings, const std::vector<std::string>& scene_files,
                                            const std::vector<int64_t>&) override {
    if (settings.method != "tessera") return absl::InvalidArgumentError("no method " + settings.method);
    PlannedTask task{"ingest", "read the scene", -1, "{}", 1, {}};
    for (size_t i = 0; i < scene_files.size(); ++i) task.scene_files.Edit().push_back(static_cast<int>(i));
    return std::vector<PlannedTask>{std::move(task)};
  }
  StatusOr<std::vector<PlannedTask>> Tiles(const JobSettings& settings, const std::string& survey,
                                           const std::vector<std::string>&, const UpdateBase*,
                                           const FinePart*) override {
    if (survey == "bad") return absl::InvalidArgumentError("bad survey");
    std::vector<PlannedTask> tasks;
    for (int tile = 0; tile < settings.tiles; ++tile) {
      const std::string parameters = "{\"survey\":\"" + survey + "\",\"tile\":" + std::to_string(tile) + "}";
      if (exchange) {
        const std::string name = "cut tile " + std::to_string(tile);
        tasks.push_back({"cut", name, tile, parameters, 1, {{TaskId(0), "mesh"}}});
      } else {
        tasks.push_back(Refine(tile, parameters));
        tasks.back().inputs = {{TaskId(0), "mesh"}};
        tasks.back().scene_files.Edit() = {0};
      }
    }
    if (!exchange) tasks.push_back(Publish(settings.tiles, 1));
    return tasks;
  }
  StatusOr<std::vector<PlannedTask>> Steps(const JobSettings& settings, const std::string& survey,
                                           const std::vector<std::string>&, const std::vector<TileReads>& reads,
                                           const UpdateBase*, const std::vector<FailedTile>& quarantined,
                                           const FinePart*) override {
    std::set<int> not_cut;
    for (const FailedTile& each : quarantined) not_cut.insert(each.tile);
    std::vector<PlannedTask> tasks;
    PlannedTask publish = Publish(settings.tiles, 0);
    auto of_tile = reads.begin();
    for (int tile = 0; tile < settings.tiles; ++tile) {
      publish.inputs[tile] = {TaskId(0), "mesh", tile};
      if (not_cut.contains(tile)) continue;
      publish.inputs[tile] = {TaskId(1 + settings.tiles + static_cast<int>(tasks.size())), "refined", tile};
      tasks.push_back(Refine(tile, "{\"survey\":\"" + survey + "\"}"));
      for (const int other : (of_tile++)->visibility) {
        if (!not_cut.contains(other)) tasks.back().inputs.push_back({TaskId(1 + other), kTileFile, other});
      }
    }
    tasks.push_back(std::move(publish));
    return tasks;
  }

 private:
  static PlannedTask Refine(int tile, const std::string& parameters) {
    return {"refine", "refine tile " + std::to_string(tile), tile, parameters, tile + 1.0, {}};
  }
  static PlannedTask Publish(int tiles, int first_refine) {
    PlannedTask publish{"publish", "publish", -1, "{}", 1, {}};
    for (int tile = 0; tile < tiles; ++tile) publish.inputs.push_back({TaskId(first_refine + tile), "refined", tile});
    return publish;
  }
};

class CoordinatorTest : public testing::Test {
 protected:
  CoordinatorTest() { Restart(); }

  // As after a crash: only the records and blobs are left.
  void Restart() {
    coordinator_.reset();
    auto coordinator = Coordinator::Open({&store_, blobs_.get(), &planner_, &clock_, /*on_change=*/{}}, options_);
    ASSERT_TRUE(coordinator.ok()) << coordinator.status();
    coordinator_ = *std::move(coordinator);
  }

  NewJob AJob(int tiles, const std::string& scene_content = "{}") {
    NewJob job;
    job.scene_path = "/scene";
    job.settings.tiles = tiles;
    job.scene_files = {{"scene.json", {Sha256Hex(scene_content), static_cast<int64_t>(scene_content.size())}}};
    return job;
  }
  std::string Create(const NewJob& job) {
    const auto status = coordinator_->jobs().CreateJob(job);
    EXPECT_TRUE(status.ok()) << status.status();
    return status.ok() && Settled(status.status()).ok() ? status->header.name : "";
  }
  // Once what followed from the call is stored too: tests look into the store.
  Status Settled(const Status& status) {
    if (!store_.fail) coordinator_->core().Durable().IgnoreError();
    return status;
  }
  std::string Worker(const std::string& machine = "host/boot") {
    return *coordinator_->leases().RegisterWorker({"host", 1, 2, 1000, 0, machine});
  }

  std::optional<GrantedLease> Lease(const std::string& worker) {
    const auto lease = LeaseAndWait(*coordinator_, worker, 0, {});
    EXPECT_TRUE(lease.ok()) << lease.status();
    return lease.ok() ? *lease : std::nullopt;
  }
  // What the cut of a tile says it reads: itself and the tile before.
  virtual std::string ReadsOf(int tile) {
    std::vector<int> ids = {tile};
    if (tile > 0) ids.insert(ids.begin(), tile - 1);
    return ToJson(TileReads{ids, ids, ids, ids});
  }
  // The outputs that FakePlanner's graph expects of the task, stored.
  ReportedResult Result(const GrantedLease& lease, const std::string& survey = "survey") {
    ReportedResult result;
    result.stats = R"({"energy":1,"seconds":1,"seconds_data":0.75,"seconds_loading":0.25})";
    result.usage = {7.5, 3 << 20, 2};
    const auto add = [&](const std::string& name, const std::string& content) {
      result.outputs.push_back({name, *blobs_->PutBytes(content)});
    };
    if (lease.plan.kind == "ingest") {
      add("survey.json", survey);
      add("mesh", "mesh of " + lease.key);
    } else if (lease.plan.kind == "cut") {
      add(kTileFile, "tile " + lease.key);
      add(kReadsFile, ReadsOf(lease.plan.tile));
    } else if (lease.plan.kind == "refine") {
      add("refined", "refined " + lease.key);
    } else {
      add("mesh.ply", "published " + lease.key);
    }
    return result;
  }
  Status Succeed(const std::string& worker, const GrantedLease& lease) {
    return Settled(ReportSuccessAndWait(*coordinator_, worker, lease.task, lease.attempt, Result(lease)));
  }
  Status Fail(const std::string& worker, const GrantedLease& lease, ErrorClass error_class) {
    return Settled(ReportFailureAndWait(*coordinator_, worker, lease.task, lease.attempt, {error_class, "it broke"}));
  }
  // Works until there is nothing to do. Gives the number of attempts.
  int WorkAll(const std::string& worker) {
    int attempts = 0;
    while (auto lease = Lease(worker)) {
      EXPECT_TRUE(Succeed(worker, *lease).ok());
      ++attempts;
    }
    return attempts;
  }
  JobStatus Job(const std::string& name) { return *coordinator_->jobs().GetJob(name); }
  TaskStatus Task(const std::string& job, int index) { return coordinator_->jobs().ListTasks(job, index, 1)->at(0); }

  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  std::unique_ptr<FolderBlobs> blobs_ = *FolderBlobs::Open(folder_.path() + "/blobs");
  MemoryStore store_;
  FakePlanner planner_;
  FakeClock clock_;
  DispatchOptions options_;
  std::unique_ptr<Coordinator> coordinator_;
};

}  // namespace tessera
