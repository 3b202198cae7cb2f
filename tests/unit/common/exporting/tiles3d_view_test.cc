// How many triangles a viewer draws: the model of a viewer on small tile sets, and a city of any size.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <functional>
#include <numbers>
#include <utility>
#include <vector>

#include "common/base/random.h"
#include "common/exporting/tiles3d/tiles3d.h"
#include "common/exporting/tiles3d/tiles3d_border.h"
#include "tests/support/tileset_views.h"
#include "tests/unit/common/exporting/tiles3d_reader.h"

namespace tessera {
namespace {

// A camera at (x, y, z) that looks down along x.
ViewCamera CameraAt(double x, double y, double z, double down_rad) {
  return ViewCamera({x, y, z}, 0, down_rad, std::numbers::pi / 3);
}

ViewTile TileOfTwo() {
  ViewTile root{{Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(200, 100, 10)}, 1, 100, {}};
  root.children.push_back({{Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(100, 100, 10)}, 0, 1000, {}});
  root.children.push_back({{Eigen::Vector3d(100, 0, 0), Eigen::Vector3d(200, 100, 10)}, 0, 2000, {}});
  return root;
}

double TrianglesAt(const ViewTile& root, const ViewCamera& camera) {
  return TrianglesInView(root, Eigen::Vector3d::Zero(), camera);
}

TEST(ViewModelTest, RefinesWhereTheErrorCoversMoreThanEightPixels) {
  const ViewTile root = TileOfTwo();
  // 1 m covers 8 of 800 pixels at a distance of 100 / (2 tan 30 degrees) m from the top of the box.
  const double distance_m = 100 / (2 * std::tan(std::numbers::pi / 6));
  EXPECT_EQ(TrianglesAt(root, CameraAt(100, 50, 10 + distance_m + 0.01, std::numbers::pi / 2)), 100);
  EXPECT_EQ(TrianglesAt(root, CameraAt(100, 50, 10 + distance_m - 0.01, std::numbers::pi / 2)), 3000);
}

TEST(ViewModelTest, DrawsNothingOutsideOfTheFrustum) {
  const ViewTile root = TileOfTwo();
  EXPECT_EQ(TrianglesAt(root, CameraAt(101, 50, 5, 0)), 2000);  // the first child is behind
  EXPECT_EQ(TrianglesAt(root, CameraAt(-10, 50, 5, 0)), 3000);  // both are ahead
  EXPECT_EQ(TrianglesAt(root, CameraAt(201, 50, 5, 0)), 0);     // both are behind
  EXPECT_EQ(TrianglesAt(root, CameraAt(100, 50, 50, -1)), 0);   // it looks up
  EXPECT_EQ(TrianglesAt(root, CameraAt(-10, 500, 5, 0)), 0);    // they are at the side
}

TEST(ViewModelTest, ReadsAnExportedTileset) {
  ExportedTerrain terrain(60, 2);
  terrain.Write();
  const ViewTile root = ReadTileset(terrain.path("result"));
  double faces = 0;
  for (const auto& [id, sheet] : terrain.sheets) faces += static_cast<double>(sheet.faces.size());
  EXPECT_EQ(root.children.size(), 4u);
  const double far = TrianglesAt(root, CameraAt(0, 0, 1e5, std::numbers::pi / 2));
  EXPECT_EQ(far, CountGlbTriangles(*ReadFile(ReadTiles3d(terrain.path("result")).path)));
  EXPECT_LT(far, faces / 4);
  EXPECT_EQ(TrianglesAt(root, CameraAt(-1e4, 0, 0, std::numbers::pi)), 0);
  // With an error of 0 pixels, all leaves are drawn.
  ViewTile sharp = root;
  const std::function<void(ViewTile*)> sharpen = [&](ViewTile* tile) {
    tile->error_m = 1e9;
    for (ViewTile& child : tile->children) sharpen(&child);
  };
  sharpen(&sharp);
  EXPECT_EQ(TrianglesAt(sharp, CameraAt(0, 0, 1e5, std::numbers::pi / 2)), faces);
}

// A city that is too large to be made here. Its tiles have the errors that Tiles3dSizes allows, as many faces as it
// wants at most, and the borders that JoinTiles3d makes. tiles_bench measures that real meshes have no more.
constexpr double kVirtualSheet_m = 128, kVirtualHeight_m = 40;

// A line through a city: houses, trees and noise, an edge each 0.15 m.
std::vector<Eigen::Vector3d> VirtualStreet(double length_m) {
  Random random(5);
  std::vector<Eigen::Vector3d> line;
  double height_m = 0, until_m = 0, noise_m = 0.02;
  for (double x = 0; x < length_m; x += 0.15) {
    if (x >= until_m) {
      const uint64_t kind = random.Below(3);  // ground, house, tree
      height_m = kind == 0 ? 0 : random.Uniform(4, 20);
      noise_m = kind == 2 ? 0.5 : 0.03;
      until_m = x + random.Uniform(5, 20);
    }
    line.push_back({x + random.Uniform(-0.05, 0.05), random.Uniform(-0.08, 0.08),
                    5 * std::sin(x / 400) + height_m + random.Uniform(-noise_m, noise_m)});
  }
  return line;
}

struct VirtualLevel {
  double side_m = 0, error_m = 0, triangles = 0;
};

constexpr int kVirtualLeaf = -3;  // level of the leaves; 0: sheets

// By level from the leaves, an eighth of a sheet, up to the root.
std::vector<VirtualLevel> VirtualLevels(double city_m, const Tiles3dSizes& sizes) {
  std::vector<VirtualLevel> levels;
  std::vector<Eigen::Vector3d> street = VirtualStreet(4000);
  const double street_m = street.back().x();
  for (int level = kVirtualLeaf; level <= 0 || levels.back().side_m < city_m; ++level) {
    VirtualLevel& l = levels.emplace_back();
    l.side_m = std::ldexp(kVirtualSheet_m, level);
    const double tolerance_m = level > 0 ? sizes.border_tolerance * l.side_m : 0;
    std::vector<Eigen::Vector3d> kept;
    for (const size_t i : SimplifyTiles3dChain(street, tolerance_m)) kept.push_back(street[i]);
    street = std::move(kept);
    const double border = 4 * l.side_m * static_cast<double>(street.size()) / street_m;
    l.error_m = std::max(sizes.error * l.side_m, 2 * kTiles3dGapsInError * tolerance_m);
    l.triangles = level == kVirtualLeaf ? 28000 : static_cast<double>(sizes.node_faces) + border;
  }
  return levels;
}

// Triangles that are drawn of the square tile at (x, y), of `level`, and below.
double VirtualTriangles(const std::vector<VirtualLevel>& levels, size_t level, double x, double y, double city_m,
                        const ViewCamera& camera) {
  const double side_m = levels[level].side_m, half = city_m / 2;
  const Eigen::AlignedBox3d square(Eigen::Vector3d(x, y, 0), Eigen::Vector3d(x + side_m, y + side_m, kVirtualHeight_m));
  const Eigen::AlignedBox3d box =
      square.intersection({Eigen::Vector3d(-half, -half, 0), Eigen::Vector3d(half, half, kVirtualHeight_m)});
  if (box.isEmpty() || box.sizes().minCoeff() <= 0 || !camera.Sees(box)) return 0;
  if (level == 0 || camera.Pixels(box, levels[level].error_m) <= kViewError_px) return levels[level].triangles;
  double sum = 0;
  for (int q = 0; q < 4; ++q) {
    sum += VirtualTriangles(levels, level - 1, x + (q % 2) * side_m / 2, y + (q / 2) * side_m / 2, city_m, camera);
  }
  return sum;
}

double VirtualLargest(double city_m, const Tiles3dSizes& sizes) {
  const std::vector<VirtualLevel> levels = VirtualLevels(city_m, sizes);
  const double half = city_m / 2, corner = -levels.back().side_m / 2;
  LargestView largest;
  ForEachCamera({Eigen::Vector2d(-half, -half), Eigen::Vector2d(half, half)}, 0, [&](const ViewCamera& camera) {
    largest.Add(VirtualTriangles(levels, levels.size() - 1, corner, corner, city_m, camera), camera);
  });
  return largest.triangles;
}

TEST(Tiles3dViewTest, HasOneAndAHalfMillionTrianglesAtMostInACityOfAnySize) {
  for (const double city_m : {2000.0, 8000.0, 16000.0, 33000.0}) {
    const double largest = VirtualLargest(city_m, Tiles3dSizes());
    std::printf("%.0f m: %.2f million triangles\n", city_m, 1e-6 * largest);
    EXPECT_LE(largest, 1.5e6) << city_m << " m";
    EXPECT_GT(largest, 3e5) << city_m << " m";
  }
}

TEST(Tiles3dViewTest, HasMoreIfBordersKeepTheirVertices) {
  Tiles3dSizes sizes;
  sizes.border_tolerance = 0;
  EXPECT_GT(VirtualLargest(33000, sizes), 1.5 * VirtualLargest(33000, Tiles3dSizes()));
}

}  // namespace
}  // namespace tessera
