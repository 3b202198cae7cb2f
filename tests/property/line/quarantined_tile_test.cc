// A tile whose refinement failed keeps its start, and the result has no cracks around it.
#include <gtest/gtest.h>

#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <vector>

#include "common/job/task_parameters.h"
#include "common/meshio/ply.h"
#include "common/storage/files.h"
#include "tests/property/line/strip.h"
#include "tests/support/in_process_line.h"
#include "tests/support/read_city.h"
#include "tests/support/read_tile_state.h"
#include "tests/support/tiny_scene.h"
#include "worker/city/city_file.h"
#include "worker/tile/tile_files.h"

namespace tessera {
namespace {

using nlohmann::json;

class QuarantinedTileTest : public testing::Test {
 protected:
  static constexpr int kTile = 1;  // a tile with neighbours on both sides

  void SetUp() override {
    folder_ = FreshTestFolder("quarantined");
    ASSERT_NO_FATAL_FAILURE(SynthesizeStrip(folder_ + "/scene", 4));
    settings_ = {.tiles = 3};
    settings_.method_settings.levels = {1, 0};
    settings_.method_settings.iterations = {2, 1};
  }
  void TearDown() override { EXPECT_TRUE(RemoveTree(folder_).ok()); }

  std::vector<LineTask> Run(const std::vector<FailedTile>& quarantined) {
    auto tasks = RunLine(folder_ + "/scene", folder_ + "/" + std::to_string(runs_++), settings_, {}, quarantined);
    EXPECT_TRUE(tasks.ok()) << tasks.status();  // publish compares all shared data of tiles, byte for byte
    return tasks.ok() ? *std::move(tasks) : std::vector<LineTask>();
  }
  static json ReportOf(const std::vector<LineTask>& tasks, const std::string& file) {
    return json::parse(ReadText(tasks.back().output_dir + "/" + file));
  }
  // The state of the tile that publish reads.
  static TileState Published(const std::vector<LineTask>& tasks, int tile) {
    for (const PlannedInput& input : tasks.back().planned.inputs) {
      if (input.tile != tile) continue;
      return *ReadTileState(tasks[input.task.value()].output_dir + "/" + kStateFile);
    }
    return {};
  }

  // Whether the vertices of `before`, a state of the same or of the coarse part, are where they were. The second split
  // adds vertices and faces, and moves none.
  static void ExpectKeeps(const TileState& now, const TileState& before) {
    std::map<uint32_t, Eigen::Vector3d> at;
    for (size_t v = 0; v < now.vertex_ids.size(); ++v) at[now.vertex_ids[v]] = now.positions[v];
    size_t kept = 0;
    for (size_t v = 0; v < before.vertex_ids.size(); ++v) {
      const auto found = at.find(before.vertex_ids[v]);
      if (found == at.end()) continue;  // the faces around it are now in another core
      ++kept;
      EXPECT_EQ(found->second, before.positions[v]);
    }
    EXPECT_GT(kept, before.vertex_ids.size() / 2);
    if (now.face_ids == before.face_ids) {
      EXPECT_EQ(now.labels, before.labels);
    }
  }

  std::string folder_;
  JobSettings settings_;
  int runs_ = 0;
};

TEST_F(QuarantinedTileTest, CityHasNoCracksAroundATileFailedAtAnyStep) {
  const std::vector<LineTask> whole = Run({});
  ASSERT_FALSE(whole.empty());
  std::map<std::string, TileState> state_of;  // of the tile, after each of its tasks
  for (const LineTask& task : whole) {
    if (task.planned.tile != kTile || task.outcome.outputs != std::vector<std::string>{kStateFile}) continue;
    state_of[task.planned.name] = *ReadTileState(task.output_dir + "/" + kStateFile);
  }
  // Sequence: labels, two iterations on level 1, the second split, one iteration on level 0, labels. Pairs of the
  // failing task and the task whose state remains; empty: the start.
  struct Case {
    const char* kind;
    int step;
    bool before, fine;
    const char* stays;
  };
  constexpr Case kCases[] = {{kCutKind, -1, false, false, ""},
                             {kMeasureKind, 0, false, false, ""},
                             {kMendKind, 1, true, false, "solve tile 1 step 0"},
                             {kSolveKind, 2, false, false, "mend tile 1 before step 1"},
                             {kCutKind, -1, false, true, "mend tile 1 step 2"},
                             {kCropKind, -1, false, true, "mend tile 1 step 2"},
                             {kSolveKind, 3, false, true, "mend tile 1 step 2"},
                             {kSolveKind, 4, false, true, "mend tile 1 step 3"}};
  for (const Case& each : kCases) {
    const FailedTile failed = {kTile, each.kind, each.step, each.before, each.fine};
    const std::string stays = each.stays;
    SCOPED_TRACE(failed.kind + " " + std::to_string(failed.step));
    const std::vector<LineTask> tasks = Run({failed});
    ASSERT_FALSE(tasks.empty());
    const json report = ReportOf(tasks, kReportFile), index = ReportOf(tasks, kTileIndexFile);
    EXPECT_EQ(report.at("seams").at("different"), 0) << report.at("seams").dump();
    EXPECT_NE(report.at("warnings").dump().find("tile 1 is quarantined"), std::string::npos);
    for (int tile = 0; tile < 3; ++tile) {
      EXPECT_EQ(report.at("tiles")[tile].contains("quarantined"), tile == kTile);
      EXPECT_EQ(index.at("tiles")[tile].contains("quarantined"), tile == kTile);
    }
    const TileState left = Published(tasks, kTile);
    int starts = 0;  // one a tile begins the fine part
    for (const LineTask& task : tasks) starts += task.planned.kind == kStartKind;
    EXPECT_EQ(starts, stays.empty() ? 4 : 3);
    if (!stays.empty()) {
      ASSERT_TRUE(state_of.contains(stays));
      ExpectKeeps(left, state_of[stays]);
    }
    // The tile's edges are not flipped, those of other tiles are.
    const auto city = ReadCity(CityTaskOf(tasks).output_dir + "/" + kCityFile);
    const auto result = ReadPly(tasks.back().output_dir + "/" + kMeshFile);
    ASSERT_TRUE(city.ok() && result.ok());
    std::set<size_t> flipped;
    for (size_t f = 0; f < result->mesh.faces.size(); ++f) {
      if (result->mesh.faces[f] != city->mesh.faces[f]) flipped.insert(f);
    }
    EXPECT_FALSE(flipped.empty());
    for (const uint32_t f : left.face_ids) EXPECT_FALSE(flipped.contains(f));
    // The other tiles continue, and move as without the failure where they are far enough from it.
    const TileState other = Published(tasks, 0), undisturbed = Published(whole, 0);
    const std::set<uint32_t> shared(left.vertex_ids.begin(), left.vertex_ids.end());
    // The second split may differ near the failed tile; the vertices before it keep their ids.
    if (each.fine) {
      ASSERT_EQ(other.vertex_ids, undisturbed.vertex_ids);
    }
    std::map<uint32_t, Eigen::Vector3d> undisturbed_at;
    for (size_t v = 0; v < undisturbed.vertex_ids.size(); ++v) {
      undisturbed_at[undisturbed.vertex_ids[v]] = undisturbed.positions[v];
    }
    size_t same = 0, own = 0;
    for (size_t v = 0; v < other.vertex_ids.size(); ++v) {
      if (shared.contains(other.vertex_ids[v]) || !undisturbed_at.contains(other.vertex_ids[v])) continue;
      ++own;
      same += (other.positions[v] - undisturbed_at[other.vertex_ids[v]]).norm() < 1e-9;
    }
    EXPECT_GT(own, 0u);
    EXPECT_GT(same, own / 10);
  }
}

TEST_F(QuarantinedTileTest, EarlierTasksAreUnchanged) {
  const std::vector<LineTask> whole = Run({}), tasks = Run({{kTile, kSolveKind, 2}});
  std::set<std::pair<std::string, std::string>> planned;
  for (const LineTask& task : whole) planned.emplace(task.planned.name, task.planned.parameters);
  for (const LineTask& task : tasks) {
    const bool same = planned.contains({task.planned.name, task.planned.parameters});
    // After the tile's last valid state, which is that before level 1, only tasks that read no state of another stage
    // remain. The fine part has no images of the tile.
    const bool before = task.planned.kind == "ingest" || task.planned.kind == kCutKind ||
                        task.planned.name == "crop tiles 0 to 2" || task.planned.name.ends_with("step 0") ||
                        task.planned.name.ends_with("before step 1") || task.planned.name == "measure tile 0 step 1";
    EXPECT_TRUE(same || !before) << task.planned.name;
    EXPECT_FALSE(same && task.planned.name == "solve tile 0 step 1");
  }
}

}  // namespace
}  // namespace tessera
