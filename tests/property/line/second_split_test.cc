// The faces of the finest level are split from those of the coarse levels, where these have moved them.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "common/job/survey.h"
#include "common/job/task_kinds.h"
#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "tests/property/line/strip.h"
#include "tests/support/in_process_line.h"
#include "tests/support/read_city.h"
#include "tests/support/read_tile_state.h"
#include "tests/support/tiny_scene.h"
#include "worker/city/moved_city.h"
#include "worker/tile/cut_tile.h"

namespace tessera {
namespace {

class SecondSplitTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = FreshTestFolder("second_split");
    ASSERT_NO_FATAL_FAILURE(SynthesizeStrip(folder_ + "/scene", 4));
    JobSettings settings = {.tiles = 3};
    settings.method_settings.levels = {2, 0};
    settings.method_settings.iterations = {2, 1};
    auto tasks = RunLine(folder_ + "/scene", folder_ + "/work", settings);
    ASSERT_TRUE(tasks.ok()) << tasks.status();
    tasks_ = *std::move(tasks);
    coarse_folder_ = IngestOf(tasks_).output_dir;
    fine_folder_ = CityTaskOf(tasks_).output_dir;
    ASSERT_NE(coarse_folder_, fine_folder_);
    const auto coarse = ReadCity(coarse_folder_ + "/" + kCityFile), fine = ReadCity(fine_folder_ + "/" + kCityFile);
    ASSERT_TRUE(coarse.ok() && fine.ok());
    coarse_ = *coarse;
    fine_ = *fine;
  }
  void TearDown() override { EXPECT_TRUE(RemoveTree(folder_).ok()); }

  Survey SurveyIn(const std::string& folder) { return *ParseSurvey(*ReadFile(folder + "/" + kSurveyFile)); }

  std::string folder_, coarse_folder_, fine_folder_;
  std::vector<LineTask> tasks_;
  City coarse_, fine_;
};

// So an update can compare it with the scene's mesh, and the report with the input.
TEST_F(SecondSplitTest, CityStaysASplitOfTheInput) {
  ASSERT_GT(fine_.mesh.faces.size(), coarse_.mesh.faces.size());
  for (size_t v = 0; v < coarse_.mesh.vertices.size(); ++v) {
    ASSERT_EQ(fine_.mesh.vertices[v], coarse_.mesh.vertices[v]) << v;
  }
  std::map<int64_t, double> area_m2;  // by face of the input
  std::map<int64_t, int32_t> label;
  for (size_t f = 0; f < coarse_.mesh.faces.size(); ++f) {
    area_m2[coarse_.input_face[f]] += FaceArea(coarse_.mesh, f);
    label[coarse_.input_face[f]] = coarse_.mesh.labels[f];
  }
  for (size_t f = 0; f < fine_.mesh.faces.size(); ++f) {
    ASSERT_TRUE(area_m2.contains(fine_.input_face[f]));
    area_m2[fine_.input_face[f]] -= FaceArea(fine_.mesh, f);
    EXPECT_EQ(fine_.mesh.labels[f], label[fine_.input_face[f]]);
  }
  for (const auto& [face, left_m2] : area_m2) EXPECT_NEAR(left_m2, 0, 1e-9) << face;
}

TEST_F(SecondSplitTest, VerticesBeginWhereTheCoarseLevelsMovedThem) {
  const auto moved =
      MovedCity::Open(fine_folder_ + "/" + kMovedFile, static_cast<int64_t>(fine_.mesh.vertices.size()),
                      static_cast<int64_t>(fine_.mesh.faces.size()), SurveyIn(fine_folder_).cells.size());
  ASSERT_TRUE(moved.ok()) << moved.status();
  size_t compared = 0, moves = 0, states = 0;
  for (const LineTask& task : tasks_) {
    const bool of_split = task.planned.kind == kSplitKind;
    if (!of_split && task.planned.kind != kStartKind) continue;
    // What the split reads, and what the fine part starts with.
    std::vector<std::string> paths;
    for (const PlannedInput& input : task.planned.inputs) {
      if (of_split && input.output == kStateFile) {
        paths.push_back(tasks_[input.task.value()].output_dir + "/" + kStateFile);
      }
    }
    if (!of_split) paths.push_back(task.output_dir + "/" + kStateFile);
    for (const std::string& path : paths) {
      ++states;
      const auto state = ReadTileState(path);
      ASSERT_TRUE(state.ok()) << state.status();
      for (size_t v = 0; v < state->vertex_ids.size(); ++v) {
        const uint32_t id = state->vertex_ids[v];
        EXPECT_EQ(state->positions[v], moved->spans().positions[id]);
        moves += state->positions[v] != fine_.mesh.vertices[id];
        ++compared;
      }
      if (of_split) continue;
      for (size_t f = 0; f < state->face_ids.size(); ++f) {
        EXPECT_EQ(state->labels[f], moved->spans().labels[state->face_ids[f]]);
      }
    }
  }
  EXPECT_EQ(states, 6u);
  EXPECT_GT(moves, compared / 2);
}

// The cuts of the fine part rely on this: no state is farther from where the fine part begins than its steps may go.
TEST_F(SecondSplitTest, FinePartStaysNearItsBeginning) {
  const Survey survey = SurveyIn(fine_folder_);
  const auto moved = MovedCity::Open(fine_folder_ + "/" + kMovedFile, static_cast<int64_t>(fine_.mesh.vertices.size()),
                                     static_cast<int64_t>(fine_.mesh.faces.size()), survey.cells.size());
  ASSERT_TRUE(moved.ok()) << moved.status();
  double bound_m = 0, farthest_m = 0;
  bool fine = false;
  for (const LineTask& task : tasks_) {
    fine |= task.planned.kind == kSplitKind;
    if (fine && task.planned.kind == kCutKind) {
      const auto cut = ParseCutParameters(task.planned.parameters);
      ASSERT_TRUE(cut.ok()) << cut.status();
      EXPECT_EQ(cut->fine_iterations, (std::vector<int>{1, 1}));
      bound_m = CutOptionsOf(*cut, survey.gsd_m, TileRefineOptions()).visible_set.motion_m;
    }
    if (!fine || (task.planned.kind != kSolveKind && task.planned.kind != kMendKind)) continue;
    const auto state = ReadTileState(task.output_dir + "/" + kStateFile);
    ASSERT_TRUE(state.ok()) << state.status();
    for (size_t v = 0; v < state->vertex_ids.size(); ++v) {
      farthest_m = std::max(farthest_m, (state->positions[v] - moved->spans().positions[state->vertex_ids[v]]).norm());
    }
  }
  EXPECT_LE(farthest_m, bound_m);
  EXPECT_GT(farthest_m, 0.3 * bound_m);
  EXPECT_LT(bound_m, 3 * survey.gsd_m);
  for (size_t f = 0; f < fine_.mesh.faces.size(); ++f) {
    const Eigen::Vector2i at = survey.ground.Cell(MeshSpans(fine_.mesh).Centroid(f));
    const auto cell = std::find_if(survey.cells.begin(), survey.cells.end(),
                                   [&](const SurveyCell& each) { return each.x == at.x() && each.y == at.y(); });
    ASSERT_NE(cell, survey.cells.end());
    for (const uint32_t v : fine_.mesh.faces[f]) {
      EXPECT_TRUE(moved->spans().cell_boxes[static_cast<size_t>(cell - survey.cells.begin())].contains(
          moved->spans().positions[v]));
    }
  }
}

TEST_F(SecondSplitTest, CellsKeepTheirViews) {
  const Survey coarse = SurveyIn(coarse_folder_), fine = SurveyIn(fine_folder_);
  int64_t predicted = 0;
  for (const SurveyCell& cell : coarse.cells) predicted += cell.fine_faces;
  EXPECT_GT(static_cast<double>(predicted), 0.8 * static_cast<double>(fine.faces));
  EXPECT_LT(static_cast<double>(predicted), 1.3 * static_cast<double>(fine.faces));
  EXPECT_EQ(fine.faces, static_cast<int64_t>(fine_.mesh.faces.size()));
  EXPECT_EQ(fine.pairs, coarse.pairs);
  EXPECT_EQ(fine.gsd_m, coarse.gsd_m);
  size_t same = 0;
  int64_t faces = 0;
  for (const SurveyCell& cell : fine.cells) {
    faces += cell.faces;
    EXPECT_EQ(cell.fine_faces, 0);
    const auto before = std::find_if(coarse.cells.begin(), coarse.cells.end(),
                                     [&](const SurveyCell& each) { return each.x == cell.x && each.y == cell.y; });
    if (before == coarse.cells.end()) continue;
    ++same;
    EXPECT_EQ(cell.views, before->views);
  }
  EXPECT_EQ(faces, fine.faces);
  EXPECT_GE(same + 2, fine.cells.size());
}

}  // namespace
}  // namespace tessera
