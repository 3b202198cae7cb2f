#include "server/tiling/tiling.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>

#include "common/job/refine_steps.h"
#include "server/plan/graph.h"
#include "server/tiling/cost_model.h"
#include "tests/support/small_surveys.h"

namespace tessera {
namespace {

TEST(Tiling, EveryCellIsInExactlyOneCoreAndNoCoreIsEmpty) {
  Random random(4);
  for (uint64_t seed = 0; seed < 60; ++seed) {
    const Survey survey =
        RandomSurvey(1 + static_cast<int>(random.Below(30)), 1 + static_cast<int>(random.Below(30)), 0.7, seed);
    if (survey.cells.empty()) continue;
    const auto rects = Cores(survey, static_cast<int>(random.Below(40)));
    std::vector<int> cells_in(rects.size(), 0);
    for (const SurveyCell& cell : survey.cells) {
      int owners = 0;
      for (size_t r = 0; r < rects.size(); ++r) {
        const bool inside = rects[r].Contains({cell.x, cell.y});
        owners += inside;
        cells_in[r] += inside;
      }
      EXPECT_EQ(owners, 1) << "seed " << seed;
    }
    for (const int count : cells_in) EXPECT_GT(count, 0) << "seed " << seed;
  }
}

TEST(Tiling, GivesTheRequestedNumberOfTiles) {
  const Survey survey = RandomSurvey(30, 20, 1, 1);
  for (int tiles = 1; tiles <= 40; ++tiles) {
    EXPECT_EQ(Cores(survey, tiles).size(), static_cast<size_t>(tiles));
  }
}

TEST(Tiling, FollowsTheCitysShape) {
  const auto along_x = Cores(RandomSurvey(40, 4, 1, 1), 4);
  for (const CellRect& rect : along_x) EXPECT_EQ(rect.y1 - rect.y0, 4);
  const auto along_y = Cores(RandomSurvey(4, 40, 1, 1), 4);
  for (const CellRect& rect : along_y) EXPECT_EQ(rect.x1 - rect.x0, 4);
}

// Predicted core-seconds of refining each core, without its halo.
std::vector<double> SecondsOf(const Survey& survey, const std::vector<CellRect>& cores) {
  std::vector<double> seconds(cores.size(), 0.0);
  for (const SurveyCell& cell : survey.cells) {
    for (size_t i = 0; i < cores.size(); ++i) {
      if (cores[i].Contains({cell.x, cell.y})) seconds[i] += PredictCellSeconds(cell, survey, EffortOf({}, survey));
    }
  }
  return seconds;
}

TEST(Tiling, TilesHaveSimilarWork) {
  Survey survey = RandomSurvey(60, 60, 1, 1);
  for (SurveyCell& cell : survey.cells) {  // a town in sparse surroundings
    if (std::hypot(cell.x - 10, cell.y - 20) < 12) cell.faces *= 20;
  }
  for (const int tiles : {2, 3, 9, 16, 50}) {
    const std::vector<double> seconds = SecondsOf(survey, Cores(survey, tiles));
    const double mean = std::accumulate(seconds.begin(), seconds.end(), 0.0) / tiles;
    EXPECT_LT(*std::max_element(seconds.begin(), seconds.end()), 1.35 * mean) << tiles;
  }
}

TilingOptions WithMemory(int64_t bytes, const Survey& survey) {
  TilingOptions options;
  options.tile_bytes = bytes;
  options.effort = EffortOf({}, survey);
  return options;
}

TEST(Tiling, EveryTileFitsTheMemoryLimitAndUsesMuchOfIt) {
  const Survey survey = SeenFromAbove(40);
  const CellIndex cells(survey);
  size_t before = 0;
  for (const int64_t mib : {8192, 4096, 3072, 2048}) {
    const TilingOptions options = WithMemory(mib << 20, survey);
    const auto cores = LayOutTiles(cells, options);
    ASSERT_TRUE(cores.ok()) << cores.status();
    EXPECT_GE(cores->size(), before);
    before = cores->size();
    double faces = 0, filled = 0;
    for (const CellRect& core : *cores) {
      const TileWork work = MeasureTile(cells, core);
      const double bytes = kRefineBytesInterval.high *
                           static_cast<double>(PredictTileBytes(work, options.effort, /*only=*/cores->size() == 1));
      EXPECT_LE(bytes, static_cast<double>(options.tile_bytes));
      faces += work.core_faces;
      filled += bytes / static_cast<double>(options.tile_bytes);
    }
    EXPECT_EQ(faces, static_cast<double>(survey.faces));
    if (cores->size() > 1) {
      EXPECT_GT(filled / static_cast<double>(cores->size()), 0.4);
    }
  }
  EXPECT_GT(before, 1u);
}

TEST(Tiling, RequestedNumberIsExceededOnlyForAMemoryLimit) {
  const Survey survey = SeenFromAbove(40);
  EXPECT_EQ(Cores(survey, 1).size(), 1u);
  TilingOptions options = WithMemory(int64_t{512} << 20, survey);
  options.tiles = 2;
  EXPECT_GT(LayOutTiles(CellIndex(survey), options)->size(), 2u);
}

TEST(Tiling, TilesOfARequestedNumberHaveNoMemoryLimitUnlessOneIsGiven) {
  EXPECT_EQ(TileLimit_bytes(0, 0), kDefaultTileBytes);
  EXPECT_EQ(TileLimit_bytes(9, 0), std::numeric_limits<int64_t>::max());
  EXPECT_EQ(TileLimit_bytes(9, 1 << 30), 1 << 30);
  EXPECT_EQ(TileLimit_bytes(0, 1 << 30), 1 << 30);
}

TEST(Tiling, CellThatDoesNotFitIsRefusedWithAdvice) {
  Survey survey = SeenFromAbove(4);
  survey.cells[5].faces = 6'000'000;
  const auto refused = PlanTiles({.tile_memory_bytes = int64_t{3} << 30}, SurveyToJson(survey), FilesOf(survey));
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kInvalidArgument);
  const std::string message(refused.status().message());
  for (const char* word : {"cell at (", "--tile-memory", "--levels", "found 3.00 GiB"}) {
    EXPECT_NE(message.find(word), std::string::npos) << message;
  }
  EXPECT_TRUE(PlanTiles({.tile_memory_bytes = int64_t{8} << 30}, SurveyToJson(survey), FilesOf(survey)).ok());
}

TEST(CostModel, CropsCoverTheTileAndItsApron) {
  const Survey survey = SeenFromAbove(40);
  const CellIndex cells(survey);
  // 10 pixels per metre at height 0, slightly more at the top of the boxes, plus the margin of the crops.
  const TileWork work = MeasureTile(cells, {0, 0, 10, 5});
  EXPECT_EQ(work.views.size(), 6u);
  EXPECT_EQ(work.seeing_views, 6);
  const double apron_px = kApronGsd;  // plus corners of faces up to 2 m outside their cells
  EXPECT_GT(work.pixels, 6 * (800.0 + 2 * apron_px) * (400.0 + 2 * apron_px));
  EXPECT_LT(work.pixels, 6 * (950.0 + 2.1 * apron_px) * (530.0 + 2.1 * apron_px));
  EXPECT_LT(work.pair_pixels, 5 * work.pixels) << "pairs do not include the apron";
  EXPECT_GT(work.pair_pixels, 5 * 6 * 600.0 * 300.0);
  EXPECT_EQ(work.image_pixels, 6 * 64e6);
}

// Few cells chose a view, as at the border of an update's images.
TEST(CostModel, CostOfAViewDependsOnTheCellsThatChoseIt) {
  Survey survey = SeenFromAbove(40);
  const auto measure = [&](const auto& chooses) {
    for (SurveyCell& cell : survey.cells) {
      cell.faces = 100;
      cell.views.clear();
      if (chooses(cell)) cell.views.push_back(0);
    }
    return MeasureTile(CellIndex(survey), {0, 0, 10, 5});
  };
  const TileWork all = measure([](const SurveyCell&) { return true; });
  const TileWork one = measure([](const SurveyCell& cell) { return cell.x == 4 && cell.y == 2; });
  const TileWork beside = measure([](const SurveyCell& cell) { return cell.x > 20; });
  EXPECT_NEAR(one.pair_pixels, 5 * 100 * 100, 5 * 50 * 150) << "a cell has 80 x 80 pixels";
  EXPECT_GT(all.pair_pixels, 20 * one.pair_pixels);
  EXPECT_EQ(one.drawn_faces, 6 * 900) << "6 views, 3 x 3 cells";
  EXPECT_GE(all.drawn_faces, 6 * 100 * 12 * 7);
  EXPECT_LE(all.drawn_faces, 6 * 100 * 13 * 8) << "including the sample cell";
  EXPECT_EQ(beside.pair_pixels, 0);
  EXPECT_EQ(beside.drawn_faces, 0);
}

TEST(CostModel, PartialCellsCountByTheirShare) {
  Survey survey = SeenFromAbove(40);
  for (SurveyCell& cell : survey.cells) cell.faces = 100;
  const CellIndex cells(survey);
  const double visible_cells = kVisibleSetGsd * survey.gsd_m / survey.ground.cell_m;
  const double solve_cells = kSolveGsd * survey.gsd_m / survey.ground.cell_m;
  const TileWork work = MeasureTile(cells, {5, 5, 10, 10});
  EXPECT_EQ(work.core_faces, 2500);
  // The margin has rounded corners.
  EXPECT_LE(work.visible_faces, 100 * std::pow(5 + 2 * visible_cells, 2) + 1e-6);
  EXPECT_GE(work.visible_faces, 100 * (25 + 4 * 5 * visible_cells));
  EXPECT_LE(work.solve_faces, 100 * std::pow(5 + 2 * solve_cells, 2) + 1e-6);
  EXPECT_GE(work.solve_faces, 100 * (25 + 4 * 5 * solve_cells));
  // The package reaches farther.
  const double package_cells = kPackageGsd * survey.gsd_m / survey.ground.cell_m;
  EXPECT_LE(work.package_faces, 100 * std::pow(5 + 2 * package_cells, 2) + 1e-6);
  EXPECT_GE(work.package_faces, 100 * (25 + 4 * 5 * package_cells));
  EXPECT_EQ(WithFaces(work, 0.5).package_faces, 0.5 * work.package_faces);
  // Less far in the fine part, whose memory is then predicted to be less.
  const double fine_cells = kFinePackageGsd * survey.gsd_m / survey.ground.cell_m;
  EXPECT_LE(work.fine_package_faces, 100 * std::pow(5 + 2 * fine_cells, 2) + 1e-6);
  EXPECT_GE(work.fine_package_faces, 100 * (25 + 4 * 5 * fine_cells));
  EXPECT_EQ(InFinePart(work).package_faces, work.fine_package_faces);
  JobEffort parts;
  parts.fine.mends = 1;
  const int64_t whole = OfParts(PredictMend, work, parts).peak_bytes;
  parts.coarse.iterations = 1;
  parts.coarse_faces = 0.1;
  EXPECT_LT(OfParts(PredictMend, work, parts).peak_bytes, whole);
}

TEST(CostModel, ViewsOpenAheadCountUpToTheirBound) {
  TileWork work;
  work.pixels = 100e6;
  work.open_pixels = 20e6;
  RefineEffort effort;
  effort.iterations = effort.finest_share = 1;
  const auto peak = [&](double largest_crop) {
    TileWork with = work;
    with.largest_crop = largest_crop;
    return PredictRefine(with, effort).peak_bytes;
  };
  const int64_t none = peak(0), small = peak(1e6), huge = peak(50e6);
  EXPECT_GT(small, none + 4 * 1e6 * 9) << "four views, at least 9 bytes a pixel";
  EXPECT_EQ(huge - none, int64_t{256} << 20);
  work.open_pixels = work.pixels;  // there are no others
  EXPECT_EQ(peak(1e6), peak(0));
}

TEST(CostModel, CoarserLevelsCostLess) {
  JobSettings coarse, twice;
  coarse.method_settings.levels = {2, 1};
  coarse.method_settings.iterations = {3, 10};
  twice.rounds = 2 * kTesseraRounds;
  const Survey survey = SeenFromAbove(20);
  const TileWork work = MeasureTile(CellIndex(survey), {-5, -3, 15, 17});
  const auto compare = [&](Prediction (*predict)(const TileWork&, const RefineEffort&)) {
    const auto of_job = [&](const JobSettings& settings) { return OfParts(predict, work, EffortOf(settings, survey)); };
    const Prediction standard = of_job({}), less = of_job(coarse);
    EXPECT_LE(less.peak_bytes, standard.peak_bytes);
    EXPECT_LT(less.core_seconds, standard.core_seconds);
    EXPECT_GT(of_job(twice).core_seconds, standard.core_seconds);
  };
  compare(PredictRefine);
  compare(PredictMeasure);
  compare(PredictSolve);
  compare(PredictMend);
}

TEST(CostModel, EffortOfAJobIsTheSumOfItsSteps) {
  const Survey survey = SeenFromAbove(20);
  const TileWork work = MeasureTile(CellIndex(survey), {0, 0, 9, 9});
  const std::vector<RefineStep> steps = RefineStepsOf("tessera", 0, {});
  double seconds = 0;
  for (const RefineStep& step : steps) seconds += PredictMeasure(work, EffortOf(step)).core_seconds;
  EXPECT_NEAR(OfParts(PredictMeasure, work, EffortOf({}, survey)).core_seconds, seconds, 1e-9 * seconds);
}

// `paper` warps each pair in both directions in an iteration, the default method in one.
TEST(CostModel, OneDirectionHasHalfTheWarps) {
  JobSettings settings;
  const RefineEffort one = EffortOf(settings, SeenFromAbove(20)).fine;
  EXPECT_GT(one.evaluations, 0);
  EXPECT_EQ(one.warps, 0.5 * one.evaluations);
  settings.method = "paper";
  const RefineEffort both = EffortOf(settings, SeenFromAbove(20)).fine;
  EXPECT_EQ(both.warps, both.evaluations);
}

}  // namespace
}  // namespace tessera
