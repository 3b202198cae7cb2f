// Tiles are exact: for any number of tiles, and however little of each other they read, the mesh has the bytes of the
// untiled run.
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "common/job/task_parameters.h"
#include "common/meshio/ply.h"
#include "common/storage/files.h"
#include "tests/property/line/same_mesh.h"
#include "tests/property/line/strip.h"
#include "tests/support/in_process_line.h"
#include "tests/support/tiny_scene.h"
#include "worker/tile/tile_files.h"

namespace tessera {
namespace {

// A strip of the city that is longer than what a tile reads.
class ExactTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = FreshTestFolder("exact");
    ASSERT_NO_FATAL_FAILURE(SynthesizeStrip(folder_ + "/scene", 5));
  }
  void TearDown() override { EXPECT_TRUE(RemoveTree(folder_).ok()); }

  static JobSettings Settings(int tiles) {
    JobSettings settings = {.tiles = tiles};
    settings.method_settings.levels = {1, 0};
    settings.method_settings.iterations = {2, 2};
    return settings;
  }

  // Path of the mesh. With several tiles, also checks that shared samples were compared, and adds to `unread` the
  // pairs of tiles of which one does not read the other's sums.
  std::string Run(const JobSettings& settings, int* unread) const {
    const std::string work = folder_ + (settings.tiles == 1 ? "/untiled" : "/tiled");
    EXPECT_TRUE(RemoveTree(work).ok());
    const auto tasks = RunLine(folder_ + "/scene", work, settings);
    EXPECT_TRUE(tasks.ok()) << tasks.status();
    if (!tasks.ok()) return "";
    std::set<int> cut;
    for (const LineTask& task : *tasks) {
      if (task.planned.kind == kCutKind) cut.insert(task.planned.tile);
    }
    const int tiles = static_cast<int>(cut.size());
    EXPECT_EQ(tiles, settings.tiles);
    for (const LineTask& task : *tasks) {
      if (task.planned.kind != kCutKind || tiles == 1) continue;
      const auto reads = ParseTileReads(ReadText(task.output_dir + "/" + kReadsFile), task.planned.tile, tiles);
      EXPECT_TRUE(reads.ok()) << reads.status();
      if (reads.ok()) *unread += tiles - static_cast<int>(reads->solve.size());
    }
    if (tiles > 1) {
      const nlohmann::json report = nlohmann::json::parse(ReadText(tasks->back().output_dir + "/" + kReportFile));
      EXPECT_EQ(report.at("seams").at("different").get<int64_t>(), 0) << report.at("seams").dump();
      EXPECT_GT(report.at("seams").at("samples").get<int64_t>(), 0);
    }
    return tasks->back().output_dir + "/" + kMeshFile;
  }

  // Compares one tile with other numbers of tiles.
  void ExpectSame(const std::vector<int>& tiles, const JobSettings& settings) const {
    int unread = 0;
    JobSettings job = settings;
    job.tiles = 1;
    const std::string untiled = Run(job, &unread);
    ASSERT_FALSE(untiled.empty());
    for (const int count : tiles) {
      job.tiles = count;
      const std::string tiled = Run(job, &unread);
      ASSERT_FALSE(tiled.empty());
      EXPECT_TRUE(SameMesh(untiled, tiled)) << count << " tiles";
    }
    EXPECT_GT(unread, 0) << "the test is void: every tile reads every other";
  }

  std::string folder_;
};

TEST_F(ExactTest, AnyNumberOfTilesGivesTheSameBytes) { ExpectSame({2, 4, 9}, Settings(1)); }

TEST_F(ExactTest, SoDoesThePapersMethod) {
  JobSettings settings = Settings(1);
  settings.method = "paper";
  settings.rounds = 2;
  settings.method_settings.iterations = {1, 1};
  ExpectSame({9}, settings);
}

// No vertex moves.
TEST_F(ExactTest, LabelsOnlyIsExact) {
  JobSettings settings;
  settings.method = "labels";
  ExpectSame({2, 9}, settings);
  settings.tiles = 2;
  int unread = 0;
  const auto start = ReadPly(folder_ + "/scene/mesh.ply"), result = ReadPly(Run(settings, &unread));
  ASSERT_TRUE(start.ok() && result.ok());
  ASSERT_GE(result->mesh.vertices.size(), start->mesh.vertices.size());
  for (size_t v = 0; v < start->mesh.vertices.size(); ++v) {
    // Spacing of the local frame's grid.
    ASSERT_LE((result->mesh.vertices[v] - start->mesh.vertices[v]).norm(), std::ldexp(1, -20)) << "vertex " << v;
  }
}

TEST_F(ExactTest, ComputedLikelihoodsAreExact) {
  JobSettings settings = Settings(1);
  settings.classifier = kDefaultClassifier;
  settings.method_settings.contour = 2;  // class borders affect the contours
  ExpectSame({2, 9}, settings);

  // Every tile uses the border trust measured over all views.
  settings.tiles = 2;
  const auto tasks = RunLine(folder_ + "/scene", folder_ + "/borders", settings);
  ASSERT_TRUE(tasks.ok()) << tasks.status();
  std::string known;
  int cuts = 0;
  for (const LineTask& task : *tasks) {
    if (task.planned.kind == kBordersKind) known = ReadText(task.output_dir + "/" + kBordersFile);
    if (task.planned.kind != kCutKind) continue;
    ++cuts;
    const auto package = ReadTilePackage(task.output_dir + "/" + kTileFile);
    ASSERT_TRUE(package.ok()) << package.status();
    EXPECT_EQ(BordersToJson(package->borders), known);
    double weight = 0;
    for (int a = 0; a < 4; ++a) {
      for (int b = a + 1; b < 4; ++b) weight += package->borders.Of(a, b).weight;
    }
    EXPECT_GT(weight, 0) << "the test is void: no border is trusted";
  }
  EXPECT_EQ(cuts, 2 * 2) << "for the coarse levels and for the finest one";
}

// Contours read farther than so small a window.
TEST_F(ExactTest, StrongContoursWithASmallWindowAreExact) {
  JobSettings settings = Settings(1);
  settings.method_settings.window_px = 3;
  settings.method_settings.contour = 20;
  ExpectSame({9}, settings);
}

// Wrong sums of a tile are detected by the neighbour that also measures some of its faces.
TEST_F(ExactTest, WrongSumsAreDetectedByANeighbour) {
  int64_t changed = 0;
  const auto runner = [&](const TaskRequest& request) {
    StatusOr<TaskOutcome> outcome = RunTask(request, {});
    if (!outcome.ok() || request.kind != "measure") return outcome;
    const std::string path = request.output_dir + "/" + kSumsFile;
    StatusOr<TileSums> sums = ReadTileSums(path);
    EXPECT_TRUE(sums.ok()) << sums.status();
    if (!sums.ok() || sums->tile != 1) return outcome;
    for (FaceSums& face : sums->photo) {
      face.gradient[0] = std::nextafter(face.gradient[0], 1.0f);
      ++changed;
    }
    EXPECT_TRUE(WriteTileSums(path, *sums).ok());
    return outcome;
  };
  const auto tasks = RunLine(folder_ + "/scene", folder_ + "/wrong", Settings(2), runner);
  ASSERT_TRUE(tasks.ok()) << tasks.status();
  EXPECT_GT(changed, 0);
  const nlohmann::json report = nlohmann::json::parse(ReadText(tasks->back().output_dir + "/" + kReportFile));
  EXPECT_GT(report.at("seams").at("different").get<int64_t>(), 0);
  size_t warned = 0;
  for (const LineTask& task : *tasks) warned += task.planned.kind == "solve" && !task.outcome.warnings.empty();
  EXPECT_GT(warned, 0u);
}

// A large smoothness weight propagates labels far.
TEST_F(ExactTest, SmoothLabelsSolvedLastAreExact) {
  JobSettings settings = Settings(1);
  settings.method_settings.label_smoothness = 20;
  settings.method_settings.labels_first = false;
  ExpectSame({9}, settings);
}

}  // namespace
}  // namespace tessera
