#include "server/plan/rollback.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tessera {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr int kSide = 3, kCells = 2;  // tiles per side of the city, cells per side of a tile

Digest ContentDigest(const std::string& content) { return {Sha256Hex(content), static_cast<int64_t>(content.size())}; }

// 3 x 3 tiles, row by row, and their states after each of a chain of jobs. jobs/0 refined all tiles.
struct City {
  Survey survey;
  std::vector<UpdateBase> jobs;  // oldest first

  City() {
    survey.gsd_m = 0.1;
    survey.ground.cell_m = 10;
    for (int y = 0; y < kSide * kCells; ++y) {
      for (int x = 0; x < kSide * kCells; ++x) {
        SurveyCell& cell = survey.cells.emplace_back();
        cell.x = x;
        cell.y = y;
        cell.reach_m = 1;
      }
    }
    UpdateBase& first = jobs.emplace_back();
    first.name = "jobs/0";
    first.city = ContentDigest("city");
    for (int t = 0; t < kSide * kSide; ++t) {
      const int x = t % kSide * kCells, y = t / kSide * kCells;
      first.tiles.push_back({t, {x, y, x + kCells, y + kCells}});
      first.states.push_back(ContentDigest("start" + std::to_string(t)));
    }
  }

  // Adds a job that refines these tiles, based on the last job.
  void Redo(const std::vector<int>& tiles) {
    UpdateBase job = jobs.back();
    job.name = "jobs/" + std::to_string(jobs.size());
    for (const int t : tiles) job.states[t] = ContentDigest(job.name + " " + std::to_string(t));
    jobs.push_back(std::move(job));
  }

  // Adds a job that restores these tiles from an earlier job.
  void GoBack(const std::vector<int>& tiles, size_t to) {
    Redo({});
    for (const int t : tiles) jobs.back().states[t] = jobs[to].states[t];
  }

  StatusOr<std::vector<int>> Back(size_t to, const std::vector<int>& named) const {
    return TilesToRollBack({jobs.rbegin(), jobs.rend() - static_cast<std::ptrdiff_t>(to)}, survey, named);
  }
  std::vector<int> MustBack(size_t to, const std::vector<int>& named) const {
    const auto tiles = Back(to, named);
    EXPECT_TRUE(tiles.ok()) << tiles.status();
    return tiles.ok() ? *tiles : std::vector<int>();
  }
  std::string Refusal(size_t to, const std::vector<int>& named) const {
    const Status status = Back(to, named).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << status;
    return std::string(status.message());
  }
};

TEST(Rollback, NeighboursRefinedByOneJobAreRestoredTogether) {
  City city;
  city.Redo({0, 1, 5, 8});  // 1 and 5 touch at a corner
  EXPECT_THAT(city.MustBack(0, {0, 1, 5, 8}), ElementsAre(0, 1, 5, 8));
  EXPECT_THAT(city.Refusal(0, {8, 0}), AllOf(HasSubstr("tiles 1, 5 must be restored too"),
                                             HasSubstr("tessera rollback jobs/1 --to jobs/0 --tile 0 --tile 1 --tile 5 "
                                                       "--tile 8")));
  city.Redo({7});
  EXPECT_THAT(city.MustBack(1, {7}), ElementsAre(7));
  EXPECT_THAT(city.MustBack(0, {7}), ElementsAre(7)) << "its shared vertices were frozen when it was refined";
}

TEST(Rollback, SeparateTilesAreRestoredAlone) {
  City city;
  city.Redo({0, 2, 6});
  EXPECT_THAT(city.MustBack(0, {2}), ElementsAre(2));
  // Tiles whose faces extend to each other are not separate.
  for (SurveyCell& cell : city.survey.cells) cell.reach_m = 10;
  EXPECT_THAT(city.Refusal(0, {2}), HasSubstr("tiles 0, 6 must be restored too"));
}

TEST(Rollback, NeighboursOfDifferentJobsAreRestoredAlone) {
  City city;
  city.Redo({3});
  city.Redo({4});
  EXPECT_THAT(city.MustBack(0, {3}), ElementsAre(3));
  EXPECT_THAT(city.MustBack(1, {4}), ElementsAre(4));
  city.Redo({3, 4});
  EXPECT_THAT(city.Refusal(0, {3}), HasSubstr("tile 4 must be restored too"));
}

TEST(Rollback, EqualTilesAreNotCoupled) {
  City city;
  city.Redo({0, 1});
  city.GoBack({0, 1}, 0);
  city.Redo({0});
  EXPECT_THAT(city.MustBack(0, {0, 1}), ElementsAre(0));
  EXPECT_THAT(city.Refusal(0, {1}), HasSubstr("those named are the same in jobs/3 and jobs/0"));
  EXPECT_THAT(city.Refusal(1, {0}), HasSubstr("tile 1 must be restored too")) << "one job restored both";
}

TEST(Rollback, DefaultIsAllTilesThatDiffer) {
  City city;
  city.Redo({0, 1});
  city.Redo({8});
  EXPECT_THAT(city.MustBack(0, {}), ElementsAre(0, 1, 8));
  EXPECT_THAT(city.MustBack(1, {}), ElementsAre(8));
  city.Redo({});
  EXPECT_THAT(city.Refusal(2, {}), HasSubstr("all are the same"));
}

TEST(Rollback, InvalidRollbacksAreRefused) {
  City city;
  city.Redo({0});
  EXPECT_THAT(city.Refusal(0, {9}), HasSubstr("found 9, expected one of the 9 tiles of jobs/1"));
  EXPECT_THAT(city.Refusal(0, {-1}), HasSubstr("found -1"));
  city.jobs[0].city = ContentDigest("another");
  EXPECT_THAT(city.Refusal(0, {0}), HasSubstr("found different meshes in jobs/0 and jobs/1"));
}

TEST(Rollback, PlanOnlyPublishesGivenStates) {
  City city;
  UpdateBase base = city.jobs.back();
  base.survey_json = SurveyToJson(city.survey);
  const auto tasks = PlanRollback(base);
  ASSERT_TRUE(tasks.ok()) << tasks.status();
  ASSERT_EQ(tasks->size(), 2u);
  const PlannedTask &taken = (*tasks)[0], &publish = (*tasks)[1];
  EXPECT_EQ(taken.given->back().name, "0008/state.arrays");
  EXPECT_EQ(taken.given->back().digest, base.states[8]);
  EXPECT_EQ(publish.kind, kPublishKind);
  EXPECT_EQ(publish.inputs.size(), 2 + base.tiles.size());
  for (const PlannedInput& input : publish.inputs) {
    EXPECT_TRUE(std::any_of(taken.given->begin(), taken.given->end(), [&](const NamedDigest& given) {
      return given.name == input.output;
    })) << input.output;
  }
}

TEST(Rollback, OutdatedFacesStayFlagged) {
  City city;
  UpdateBase base = city.jobs.back();
  base.survey_json = SurveyToJson(city.survey);
  base.outdated = ContentDigest("flags");
  base.flip_edges = true;
  const auto tasks = PlanRollback(base);
  ASSERT_TRUE(tasks.ok()) << tasks.status();
  EXPECT_EQ((*tasks)[0].given->back().name, kOutdatedFile);
  EXPECT_EQ((*tasks)[0].given->back().digest, *base.outdated);
  EXPECT_EQ((*tasks)[1].inputs.back().output, kOutdatedFile);
  EXPECT_TRUE(ParsePublishParameters((*tasks)[1].parameters)->outdated);
  EXPECT_TRUE(ParsePublishParameters((*tasks)[1].parameters)->flip_edges) << "as in the base";
}

}  // namespace
}  // namespace tessera
