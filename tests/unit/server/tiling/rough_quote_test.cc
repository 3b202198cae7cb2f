// Rough quotes lie around the quote of the survey.
#include "server/tiling/rough_quote.h"

#include <gtest/gtest.h>

#include <cmath>

#include "server/tiling/scene_survey.h"

namespace tessera {
namespace {

// Hills of `side` x `side` m with faces of 2 m, and nadir images 60 m apart from 100 m above.
struct Hills {
  SceneDescription scene;
  TriangleMesh mesh;
};

Hills MakeHills(int side, int image_side_px) {
  Hills hills;
  const int n = side / 2 + 1;
  for (int y = 0; y < n; ++y) {
    for (int x = 0; x < n; ++x)
      hills.mesh.vertices.emplace_back(2 * x, 2 * y, 3 * std::sin(0.1 * x) * std::cos(0.07 * y));
  }
  for (int y = 0; y + 1 < n; ++y) {
    for (int x = 0; x + 1 < n; ++x) {
      const auto a = static_cast<uint32_t>(y * n + x), b = a + static_cast<uint32_t>(n);
      hills.mesh.faces.push_back({a, a + 1, b});
      hills.mesh.faces.push_back({a + 1, b + 1, b});
    }
  }
  hills.scene.up_in_local = Eigen::Vector3d::UnitZ();
  hills.scene.classes.resize(3);
  for (int y = 0; y <= side; y += 60) {
    for (int x = 0; x <= side; x += 60) {
      SceneView view;
      const double half = image_side_px / 2.0;
      view.camera.intrinsics = {image_side_px, image_side_px, 100.0 * image_side_px / 150, 100.0 * image_side_px / 150,
                                half,          half};
      view.camera.rotation_cam_from_world << 1, 0, 0, 0, -1, 0, 0, 0, -1;
      view.camera.translation_cam_from_world = -view.camera.rotation_cam_from_world * Eigen::Vector3d(x, y, 100);
      view.lens.pinhole = view.camera.intrinsics;
      hills.scene.views.push_back(view);
    }
  }
  return hills;
}

// Each `stride`-th face with its own vertices.
MeshSample SampleOf(const TriangleMesh& mesh, size_t stride) {
  MeshSample sample;
  sample.faces = static_cast<int64_t>(mesh.faces.size());
  for (size_t f = 0; f < mesh.faces.size(); f += stride) {
    const auto next = static_cast<uint32_t>(sample.mesh.vertices.size());
    for (int k = 0; k < 3; ++k) sample.mesh.vertices.push_back(mesh.Corner(f, k));
    sample.mesh.faces.push_back({next, next + 1, next + 2});
  }
  return sample;
}

bool Contains(const Interval& interval, double value) { return interval.low <= value && value <= interval.high; }

TEST(RoughQuoteTest, ItsRangesContainTheQuoteOfTheWholeMesh) {
  const Hills hills = MakeHills(240, 900);
  JobSettings settings;
  settings.tile_memory_bytes = int64_t{256} << 20;
  const auto gsd = MedianGsd(hills.scene, hills.mesh);
  ASSERT_TRUE(gsd.ok());
  const auto exact = MakeQuote(settings, EstimateSurvey(hills.scene, hills.mesh, *gsd));
  ASSERT_TRUE(exact.ok()) << exact.status();
  for (const size_t stride : {1, 7}) {
    const auto rough = MakeRoughQuote(settings, hills.scene, SampleOf(hills.mesh, stride));
    ASSERT_TRUE(rough.ok()) << rough.status();
    EXPECT_EQ(rough->share, 1);
    EXPECT_TRUE(Contains(rough->area_m2, exact->area_m2)) << stride;
    EXPECT_TRUE(Contains(rough->core_seconds, exact->core_seconds)) << stride;
    EXPECT_TRUE(Contains(rough->peak_bytes, static_cast<double>(exact->peak_bytes))) << stride;
    EXPECT_TRUE(Contains(rough->stored_bytes, static_cast<double>(exact->stored_bytes))) << stride;
    EXPECT_TRUE(Contains(rough->tiles, static_cast<double>(exact->tiles.size()))) << stride;
    EXPECT_NEAR(rough->gsd_m, *gsd, 0.05 * *gsd);
    EXPECT_LT(rough->core_seconds.high, 10 * rough->core_seconds.low);
  }
}

TEST(RoughQuoteTest, RequestedTilesAreExact) {
  const Hills hills = MakeHills(180, 900);
  JobSettings settings;
  settings.tiles = 5;
  const auto rough = MakeRoughQuote(settings, hills.scene, SampleOf(hills.mesh, 7));
  ASSERT_TRUE(rough.ok()) << rough.status();
  EXPECT_EQ(rough->tiles.low, 5);
  EXPECT_EQ(rough->tiles.high, 5);
}

// The time does not grow with the city: a part is computed and scaled.
TEST(RoughQuoteTest, OfALargeCityAPartIsComputed) {
  const Hills small = MakeHills(300, 900);
  JobSettings settings;
  const auto rough = MakeRoughQuote(settings, small.scene, SampleOf(small.mesh, 3), /*most_cells=*/500);
  ASSERT_TRUE(rough.ok()) << rough.status();
  EXPECT_LT(rough->share, 1);
  EXPECT_TRUE(Contains(rough->area_m2, 300.0 * 300.0)) << rough->area_m2.low << " " << rough->area_m2.high;
}

TEST(RoughQuoteTest, ImagesThatSeeNothingAreRefused) {
  Hills hills = MakeHills(180, 900);
  for (SceneView& view : hills.scene.views) view.camera.translation_cam_from_world.z() -= 1000;
  EXPECT_EQ(MakeRoughQuote({}, hills.scene, SampleOf(hills.mesh, 7)).status().code(),
            absl::StatusCode::kFailedPrecondition);
}

}  // namespace
}  // namespace tessera
