// What stands outside a tile and hides it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/base/parallel.h"
#include "tests/support/held_pixels.h"
#include "tests/support/tiny_scene.h"
#include "worker/refine/density.h"
#include "worker/refine/pairs.h"
#include "worker/tasks/cell_views.h"
#include "worker/tasks/cut_tile.h"
#include "worker/tasks/methods.h"
#include "worker/tasks/refine_tile.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

constexpr int kFacade = 1, kFiner = 3;

// A house in the tile; a tower outside it and its halo, between the house's eastern facade and the views of it.
class Occlusion : public testing::Test {
 protected:
  Occlusion() {
    TinySceneOptions options;
    options.tower = true;
    options.finer = kFiner;
    scene_ = MakeTinyScene(options);
    const SplitMesh split = SplitLargeFaces(scene_.mesh, scene_.cameras, DensityOptions());
    survey_.gsd_m = 0.2 / kFiner;
    survey_.ground = MakeGroundPlane(survey_.up, 4);
    survey_.classes.resize(3);
    survey_.has_likelihoods = true;
    for (size_t v = 0; v < scene_.cameras.size(); ++v) {
      SceneView view;
      view.name = scene_.image_names[v];
      view.camera = scene_.cameras[v];
      view.lens.pinhole = view.camera.intrinsics;
      survey_.views.push_back(view);
    }
    survey_.cells = CellsOf(split.mesh, survey_.ground);
    const std::string path = FreshTestFolder("city") + "/city.arrays";
    EXPECT_TRUE(
        WriteCity(path, {split.mesh, split.parent_face}, survey_.ground, survey_.cells, testing::TempDir(), 500).ok());
    auto opened = CityReader::Open(path);
    EXPECT_TRUE(opened.ok()) << opened.status();
    city_ = *std::move(opened);
    EXPECT_TRUE(ChooseViews(split.mesh, city_, {}, {}, testing::TempDir(), &survey_).ok());
    for (const ViewPair& pair : SelectPairs(split.mesh, scene_.cameras, PairOptions())) {
      survey_.pairs.push_back({pair.reference, pair.other});
    }
  }

  TilePackage Cut(const OccluderOptions& options = {}) const {
    CutParameters parameters = {{0, {-2, -2, 2, 2}}, 3, {}};
    for (size_t v = 0; v < survey_.views.size(); ++v) parameters.views.push_back(static_cast<int32_t>(v));
    auto package = CutTile(city_, survey_, parameters, options);
    EXPECT_TRUE(package.ok()) << package.status();
    return *std::move(package);
  }

  // The photographs, whole, with likelihoods that are sure.
  std::vector<TileView> Photographs(const TilePackage& package) const {
    std::vector<TileView> views;
    for (size_t v = 0; v < package.views.size(); ++v) {
      TileView view;
      view.view = static_cast<int>(v);
      view.window = package.views[v].camera;
      FloatImage luminance = scene_.pictures[v];
      for (float& value : luminance.data) value = std::isnan(value) ? 0 : value;
      const LabelImage& labels = scene_.label_pictures[v];
      FloatImage likelihoods(labels.width, labels.height, 3, 0.1f);
      for (size_t i = 0; i < labels.data.size(); ++i) {
        if (labels.data[i] < 3) likelihoods.plane(labels.data[i])[i] = 0.8f;
      }
      view.pixels = std::make_shared<HeldPixels>(std::move(luminance), std::move(likelihoods),
                                                 TileSilhouettes(package, view.window));
      views.push_back(std::move(view));
    }
    return views;
  }

  struct Facade {
    double rms_m = 0;         // of its vertices' distance from where the facade is in truth
    double wrong_labels = 0;  // share of its area
    double seen = 0;          // share of its area whose label views tell
  };

  // What refining makes of the eastern facade, which is true from the start: all that it does there is damage.
  static Facade Refine(const TilePackage& package, const std::vector<TileView>& views,
                       const RefineParameters& parameters) {
    const auto options = MethodOptions(parameters, package.classes);
    EXPECT_TRUE(options.ok());
    const auto refined = RefineTile(package, views, {}, *options, {}, SystemClock());
    EXPECT_TRUE(refined.ok()) << refined.status();
    Facade facade;
    double squares = 0, area = 0;
    int vertices = 0;
    const auto on_facade = [&](const Eigen::Vector3d& p) {
      return std::abs(p.x() - 6) < 1e-6 && p.z() > 1 && p.z() < 7 && std::abs(p.y()) < 5;
    };
    for (size_t v = 0; v < package.mesh.vertices.size(); ++v) {
      if (!on_facade(package.mesh.vertices[v])) continue;
      squares += std::pow(refined->result.positions[v].x() - package.mesh.vertices[v].x(), 2);
      ++vertices;
    }
    for (size_t f = 0; f < package.mesh.faces.size(); ++f) {
      if (!on_facade((package.mesh.Corner(f, 0) + package.mesh.Corner(f, 1) + package.mesh.Corner(f, 2)) / 3)) continue;
      const double face_area = FaceArea(package.mesh, f);
      area += face_area;
      if (refined->result.labels[f] != kFacade) facade.wrong_labels += face_area;
      if (refined->result.seen[f]) facade.seen += face_area;
    }
    EXPECT_GT(vertices, 20);
    facade.rms_m = std::sqrt(squares / vertices);
    facade.wrong_labels /= area;
    facade.seen /= area;
    return facade;
  }

  TinyScene scene_;
  CityReader city_;
  Survey survey_;
};

TEST_F(Occlusion, ATowerOutsideTheHaloDamagesAFacadeUnlessItIsAmongTheOccluders) {
  const TilePackage with = Cut();
  ASSERT_FALSE(with.occluders.faces.empty());
  for (const Eigen::Vector3d& p : with.mesh.vertices) ASSERT_LT(p.x(), 11.9) << "the tower is outside";
  TilePackage without = with;
  without.occluders = TriangleMesh();
  const std::vector<TileView> views = Photographs(with);

  const Facade labelled = Refine(with, views, {}), mislabelled = Refine(without, views, {});
  EXPECT_LT(labelled.wrong_labels, 0.02);
  EXPECT_GT(mislabelled.wrong_labels, 0.8);
  EXPECT_GT(labelled.seen, 0.3) << "or the label is no view's";

  RefineParameters images_alone = {0, "baseline"};
  images_alone.settings.levels = {0};
  images_alone.settings.iterations = {10};
  const Facade whole = Refine(with, views, images_alone), bent = Refine(without, views, images_alone);
  EXPECT_GT(bent.rms_m, 1.3 * whole.rms_m);
  EXPECT_LT(whole.rms_m, survey_.gsd_m);
}

// Leaving out what hides nothing and simplifying the rest changes next to nothing of what views see.
TEST_F(Occlusion, FewerOccludersHideTheSame) {
  const TilePackage all = Cut({.only_seen = false, .share_px = 0}), seen = Cut({.share_px = 0}), fewest = Cut();
  EXPECT_LT(seen.occluders.faces.size(), all.occluders.faces.size());
  EXPECT_LT(fewest.occluders.faces.size(), seen.occluders.faces.size());
  int64_t pixels = 0, other = 0, hidden = 0;
  for (const SceneView& view : all.views) {
    const FaceMap bare = RasterizeFaces(all.mesh, nullptr, view.camera);
    const FaceMap expected = RasterizeFaces(all.mesh, &all.occluders, view.camera);
    EXPECT_EQ(RasterizeFaces(all.mesh, &seen.occluders, view.camera).face, expected.face);
    const FaceMap map = RasterizeFaces(all.mesh, &fewest.occluders, view.camera);
    for (size_t i = 0; i < map.face.size(); ++i) {
      pixels += expected.face[i] >= 0;
      hidden += bare.face[i] >= 0 && expected.face[i] < 0;
      other += map.face[i] != expected.face[i];
    }
  }
  EXPECT_GT(hidden, 1000) << "or the test shows nothing";
  EXPECT_LT(other, pixels / 10000);
}

TEST_F(Occlusion, SameOccludersForAnyNumberOfThreads) {
  const TilePackage many = Cut();
  const ThreadLimit limit(1);
  const TilePackage one = Cut();
  EXPECT_EQ(one.occluders.faces, many.occluders.faces);
  EXPECT_EQ(one.occluders.vertices, many.occluders.vertices);
}

TEST(OccluderSearch, ToleranceIsAShareOfWhatAPixelSpansInTheStrictestViewThatMatters) {
  TriangleMesh tile;
  tile.vertices = {{-5, -5, 0}, {5, -5, 0}, {0, 5, 0}};
  tile.faces = {{0, 1, 2}};
  SceneView view;  // from 100 m above, looking down
  view.camera.intrinsics = {400, 400, 1000, 1000, 200, 200};
  view.camera.rotation_cam_from_world = Eigen::Vector3d(1, -1, -1).asDiagonal();
  view.camera.translation_cam_from_world = {0, 0, 100};
  SceneView sharper = view;
  sharper.camera.intrinsics.fx = sharper.camera.intrinsics.fy = 2000;
  const std::vector<Eigen::Vector3d> before = {{0, 0, 20}, {1, 0, 50}}, beside = {{60, 0, 20}, {61, 0, 50}};
  const OccluderSearch one(tile, {view}), two(tile, {view, sharper});
  EXPECT_DOUBLE_EQ(one.Tolerance(before, 0.5), 0.5 * 50 / 1000);
  EXPECT_DOUBLE_EQ(two.Tolerance(before, 0.5), 0.5 * 50 / 2000);
  EXPECT_EQ(one.Tolerance(beside, 0.5), std::numeric_limits<double>::infinity());
  EXPECT_EQ(one.Tolerance(std::vector<Eigen::Vector3d>{{0, 0, 20}, {0, 0, 120}}, 0.5), 0)
      << "reaches behind the camera";
}

}  // namespace
}  // namespace tessera
