// How many triangles a viewer draws of a city that is too large to be made here. The test makes its tree: boxes, errors
// and numbers of triangles by level. Errors are those that were measured on 18 copies of a real block at a GSD of 0.125
// m; borders are simplified as JoinTiles3d does.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "common/base/random.h"
#include "common/exporting/tiles3d/tiles3d.h"
#include "common/exporting/tiles3d/tiles3d_border.h"

namespace tessera {
namespace {

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

// Errors of tiles of 32, 64, ... m; larger ones have the last: all that stands on the ground is gone.
constexpr std::array<double, 5> kVirtualErrors_m = {0.14, 0.3, 1.3, 7.5, 13.6};
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
    const auto above_leaves = static_cast<size_t>(level - kVirtualLeaf);
    const double measured_m =
        above_leaves == 0 ? 0 : kVirtualErrors_m[std::min(above_leaves, kVirtualErrors_m.size()) - 1];
    l.error_m = std::max(measured_m, 2 * kTiles3dGapsInError * tolerance_m);
    l.triangles = above_leaves == 0 ? 24000 : static_cast<double>(sizes.node_faces) + border;
  }
  return levels;
}

struct VirtualCamera {
  Eigen::Vector3d position, forward, right, up;
  double vertical_rad = 0;

  VirtualCamera(const Eigen::Vector3d& at, double heading_rad, double down_rad, double fov_rad)
      : position(at), vertical_rad(fov_rad) {
    forward = {std::cos(heading_rad) * std::cos(down_rad), std::sin(heading_rad) * std::cos(down_rad),
               -std::sin(down_rad)};
    right = {std::sin(heading_rad), -std::cos(heading_rad), 0};
    up = right.cross(forward);
  }

  bool Sees(const Eigen::AlignedBox3d& box) const {
    const double tan_y = std::tan(vertical_rad / 2), tan_x = tan_y * 1280 / 800;
    const Eigen::Vector3d half = box.sizes() / 2, to = box.center() - position;
    for (const Eigen::Vector3d& normal :
         {Eigen::Vector3d(forward), Eigen::Vector3d(tan_x * forward + right), Eigen::Vector3d(tan_x * forward - right),
          Eigen::Vector3d(tan_y * forward + up), Eigen::Vector3d(tan_y * forward - up)}) {
      if (to.dot(normal) + half.dot(normal.cwiseAbs()) < 0) return false;
    }
    return true;
  }

  // Pixels that the error covers at the nearest point of the box, as CesiumJS and 3d-tiles-renderer compute it.
  double Pixels(const Eigen::AlignedBox3d& box, double error_m) const {
    return error_m * 800 / (std::max(1e-3, box.exteriorDistance(position)) * 2 * std::tan(vertical_rad / 2));
  }
};

// Triangles that are drawn of the square tile at (x, y), of `level`, and below.
double VirtualTriangles(const std::vector<VirtualLevel>& levels, size_t level, double x, double y, double city_m,
                        const VirtualCamera& camera) {
  const double side_m = levels[level].side_m;
  Eigen::AlignedBox3d box(Eigen::Vector3d(x, y, 0), Eigen::Vector3d(x + side_m, y + side_m, kVirtualHeight_m));
  const double half = city_m / 2;
  box = box.intersection({Eigen::Vector3d(-half, -half, 0), Eigen::Vector3d(half, half, kVirtualHeight_m)});
  if (box.isEmpty() || box.sizes().minCoeff() <= 0 || !camera.Sees(box)) return 0;
  if (level == 0 || camera.Pixels(box, levels[level].error_m) <= 8) return levels[level].triangles;
  double sum = 0;
  for (int q = 0; q < 4; ++q) {
    sum += VirtualTriangles(levels, level - 1, x + (q % 2) * side_m / 2, y + (q / 2) * side_m / 2, city_m, camera);
  }
  return sum;
}

double LargestView(double city_m, const Tiles3dSizes& sizes) {
  const std::vector<VirtualLevel> levels = VirtualLevels(city_m, sizes);
  double largest = 0;
  for (const double vertical_rad : {0.691, 1.047}) {  // of CesiumJS at 1,280 x 800, and 60 degrees
    for (double height_m = 60; height_m < 3 * city_m; height_m *= 1.5) {
      for (const Eigen::Vector2d& place : {Eigen::Vector2d(0.03, 0.01), Eigen::Vector2d(0.26, 0.24),
                                           Eigen::Vector2d(-0.5, 0.02), Eigen::Vector2d(-0.49, -0.49)}) {
        for (const double down_rad : {0.1, 0.3, 0.6, 1.0, 1.57}) {
          const VirtualCamera camera({place.x() * city_m, place.y() * city_m, height_m}, 0.4, down_rad, vertical_rad);
          const double corner = -levels.back().side_m / 2;
          largest = std::max(largest, VirtualTriangles(levels, levels.size() - 1, corner, corner, city_m, camera));
        }
      }
    }
  }
  return largest;
}

// The first 2 km around the camera have most of the triangles; the rest of a city adds few tiles.
TEST(Tiles3dViewTest, HasThreeMillionTrianglesAtMostInACityOfAnySize) {
  for (const double city_m : {2000.0, 8000.0, 12000.0, 16000.0, 33000.0}) {
    const double largest = LargestView(city_m, Tiles3dSizes());
    std::printf("%.0f m: %.2f million triangles\n", city_m, 1e-6 * largest);
    EXPECT_LE(largest, 3e6) << city_m << " m";
    EXPECT_GT(largest, 1e6) << city_m << " m";
  }
}

TEST(Tiles3dViewTest, HasTwiceAsManyIfBordersKeepTheirVertices) {
  Tiles3dSizes sizes;
  sizes.border_tolerance = 0;
  const double largest = LargestView(33000, sizes);
  std::printf("33000 m, all border vertices: %.2f million triangles\n", 1e-6 * largest);
  EXPECT_GT(largest, 2 * LargestView(33000, Tiles3dSizes()));
}

}  // namespace
}  // namespace tessera
