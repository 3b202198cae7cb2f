// Comparison of the fit of images before and after refinement.
#include "worker/tile/tile_fit.h"

#include <gtest/gtest.h>

#include <memory>

#include "common/base/random.h"
#include "tests/support/held_pixels.h"
#include "tests/unit/worker/tile/tiny_city.h"

namespace tessera {
namespace {

// The whole tiny city as one tile, with its images.
class TileFitTest : public testing::Test {
 protected:
  TileFitTest() : scene_(MakeTinyScene({.finer = 2})), tiny_(MakeTinyCity({.finer = 2})) {
    for (int32_t v = 0; v < static_cast<int32_t>(tiny_.survey.views.size()); ++v) {
      for (int32_t w = 0; w < static_cast<int32_t>(tiny_.survey.views.size()); ++w) {
        if (v != w) tiny_.survey.pairs.push_back({v, w});
      }
    }
    std::sort(tiny_.survey.pairs.begin(), tiny_.survey.pairs.end());
    tiny_.survey.pairs.erase(std::unique(tiny_.survey.pairs.begin(), tiny_.survey.pairs.end()),
                             tiny_.survey.pairs.end());
  }

  // The fit of the true surface moved by `start` beside that of the true surface moved by `result`.
  TileFit Compare(const Eigen::Vector3d& start, const Eigen::Vector3d& result) {
    CutOptions everything;
    std::vector<CutResult> cuts = CutAll(tiny_, {AllCells(tiny_.survey)}, everything);
    TilePackage package = std::move(cuts[0].package);
    std::vector<Eigen::Vector3d> refined = package.mesh.vertices;
    for (Eigen::Vector3d& p : package.mesh.vertices) p += start;
    for (Eigen::Vector3d& p : refined) p += result;
    std::vector<RefineView> views;
    for (size_t v = 0; v < package.views.size(); ++v) {
      RefineView& view = views.emplace_back();
      view.camera = package.views[v].camera;
      view.pixels = std::make_shared<HeldPixels>(scene_.pictures[package.view_ids[v]]);
      view.id = package.view_ids[v];
      view.index = static_cast<int>(v);
    }
    const TileWorkspace work(package);
    const TileImages images(package, std::move(views), {});
    auto fit = CompareFit(work, images, refined, {});
    EXPECT_TRUE(fit.ok()) << fit.status();
    return *std::move(fit);
  }

  const TinyScene scene_;
  TinyCity tiny_;
};

TEST_F(TileFitTest, ResultNearerToTheTruthGainsPatches) {
  const TileFit fit = Compare({0, 0, 2.5}, {0, 0, 0});
  ASSERT_GT(fit.all.patches, 200);
  EXPECT_GT(fit.all.gained, 10 * fit.all.lost);
  EXPECT_GT(fit.all.result, fit.all.start);
  EXPECT_FALSE(fit.all.IsWorse());
}

TEST_F(TileFitTest, ResultFartherFromTheTruthIsWorse) {
  const TileFit fit = Compare({0, 0, 0}, {0, 0, 2.5});
  ASSERT_GT(fit.all.patches, 200);
  EXPECT_TRUE(fit.all.IsWorse());
  EXPECT_FALSE(fit.views.empty());
  for (const auto& [view, change] : fit.views) EXPECT_GE(change.patches, change.lost + change.gained) << view;
}

TEST_F(TileFitTest, UnchangedSurfaceLosesNoPatch) {
  const TileFit fit = Compare({0, 0, 0}, {0, 0, 0});
  ASSERT_GT(fit.all.patches, 200);
  EXPECT_EQ(fit.all.lost, 0);
  EXPECT_EQ(fit.all.gained, 0);
  EXPECT_GT(fit.all.start, 0.8 * static_cast<double>(fit.all.patches));
}

TEST(FitChange, IsWorseOnlyBeyondChance) {
  EXPECT_FALSE((FitChange{1000, 500, 500, 0, 0}.IsWorse()));
  EXPECT_FALSE((FitChange{1000, 500, 470, 65, 35}.IsWorse()));  // three standard deviations
  EXPECT_TRUE((FitChange{1000, 500, 450, 75, 25}.IsWorse()));   // five
  EXPECT_FALSE((FitChange{1000, 500, 550, 25, 75}.IsWorse()));
}

TEST(TileFitJson, KeepsAllNumbers) {
  TileFit fit;
  fit.all = {9, 5, 6, 1, 2};
  fit.views[3] = {4, 3, 2, 2, 1};
  fit.centre_m = {1.5, -2.25, 1e6};
  const TileFit read = ParseTileFit(ToJson(fit));
  EXPECT_EQ(ToJson(read), ToJson(fit));
  EXPECT_EQ(read.views.at(3).lost, 2);
  EXPECT_EQ(ParseTileFit("{\"all\":[1]}").all.patches, 0);
}

}  // namespace
}  // namespace tessera
