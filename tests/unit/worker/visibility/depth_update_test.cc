// Depths of a mesh that moved a little, against drawing it anew.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

PosedCamera Oblique() {
  PosedCamera camera;
  camera.intrinsics = {201, 150, 180, 180, 100, 75};
  const double tilt = 0.6;
  camera.rotation_cam_from_world << 1, 0, 0, 0, -std::cos(tilt), -std::sin(tilt), 0, std::sin(tilt), -std::cos(tilt);
  camera.translation_cam_from_world = -(camera.rotation_cam_from_world * Vector3d(0.3, -25, 40));
  return camera;
}

TriangleMesh Grid(uint32_t cells, double side_m, double relief_m, uint64_t seed) {
  Random random(seed);
  TriangleMesh mesh;
  for (uint32_t y = 0; y <= cells; ++y) {
    for (uint32_t x = 0; x <= cells; ++x) {
      mesh.vertices.push_back({side_m * (x + 0.3 * random.Uniform()) / cells - 0.5 * side_m,
                               side_m * (y + 0.3 * random.Uniform()) / cells - 0.5 * side_m,
                               relief_m * random.Uniform()});
    }
  }
  for (uint32_t y = 0; y < cells; ++y) {
    for (uint32_t x = 0; x < cells; ++x) {
      const uint32_t a = y * (cells + 1) + x, b = a + 1, c = a + cells + 1, d = c + 1;
      mesh.faces.insert(mesh.faces.end(), {{a, b, d}, {a, d, c}});
    }
  }
  return mesh;
}

TEST(DepthUpdate, OfAMeshThatStandsStillNothingChanges) {
  const PosedCamera camera = Oblique();
  const TriangleMesh mesh = Grid(40, 60, 4, 2), roof = Grid(2, 9, 1, 3);
  TriangleMesh occluders = roof;
  for (Vector3d& v : occluders.vertices) v.z() += 8;
  Rasterizer rasterizer;
  std::vector<FaceMap> maps;
  const std::vector<PosedCamera> cameras(3, camera);
  rasterizer.DrawViews(mesh, &occluders, cameras, &maps);
  const FaceMap before = maps[0];
  rasterizer.UpdateDepths(mesh, cameras, &maps);
  rasterizer.UpdateDepth(mesh, camera, &maps[2]);
  for (const FaceMap& map : maps) {
    EXPECT_EQ(map.face, before.face);
    EXPECT_EQ(map.depth, before.depth);
  }
}

TEST(DepthUpdate, IsWhatDrawingGivesWhereTheFaceIsTheSame) {
  const PosedCamera camera = Oblique();
  TriangleMesh mesh = Grid(40, 60, 0.6, 4);  // no silhouettes within it
  TriangleMesh occluders = Grid(2, 9, 1, 3);
  for (Vector3d& v : occluders.vertices) v.z() += 8;
  Rasterizer rasterizer;
  FaceMap updated, drawn;
  rasterizer.Draw(mesh, &occluders, camera, &updated);
  const FaceMap before = updated;
  Random random(6);
  constexpr double kMove_m = 0.05;  // a fifth of a pixel
  for (Vector3d& v : mesh.vertices) {
    v += kMove_m * Vector3d(random.Uniform() - 0.5, random.Uniform() - 0.5, 2 * random.Uniform() - 1);
  }
  rasterizer.UpdateDepth(mesh, camera, &updated);
  rasterizer.Draw(mesh, &occluders, camera, &drawn);
  EXPECT_EQ(updated.face, before.face);
  int same = 0, shown = 0, moved = 0;
  for (size_t i = 0; i < drawn.face.size(); ++i) {
    if (before.face[i] < 0) {
      EXPECT_EQ(updated.depth[i], before.depth[i]);
      continue;
    }
    ++shown;
    moved += updated.depth[i] != before.depth[i];
    if (drawn.face[i] == before.face[i]) {
      ++same;
      EXPECT_EQ(updated.depth[i], drawn.depth[i]);
    } else if (drawn.face[i] >= 0) {
      // The plane of a neighbour, across an edge that passed the pixel's centre.
      EXPECT_NEAR(updated.depth[i], drawn.depth[i], 8 * kMove_m);
    }
  }
  EXPECT_GT(shown, 10000);
  EXPECT_GT(moved, shown * 9 / 10);
  EXPECT_GT(same, shown * 3 / 4);
  EXPECT_LT(same, shown);
}

TEST(DepthUpdate, AMoveWithinThePlaneKeepsItsDepth) {
  const PosedCamera camera = Oblique();
  TriangleMesh mesh = Grid(30, 60, 0, 8);
  const auto on_plane = [](double x, double y) { return Vector3d(x, y, 0.3 * x - 0.2 * y); };
  for (Vector3d& v : mesh.vertices) v = on_plane(v.x(), v.y());
  Rasterizer rasterizer;
  FaceMap map;
  rasterizer.Draw(mesh, nullptr, camera, &map);
  const FaceMap before = map;
  Random random(9);
  for (Vector3d& v : mesh.vertices) {
    v = on_plane(v.x() + 0.1 * (random.Uniform() - 0.5), v.y() + 0.1 * (random.Uniform() - 0.5));
  }
  rasterizer.UpdateDepth(mesh, camera, &map);
  int shown = 0, clamped = 0;
  for (size_t i = 0; i < map.face.size(); ++i) {
    if (map.face[i] < 0) continue;
    ++shown;
    // Rounding to the grid moves a point of this plane by some millionths; only where the face has left the pixel may
    // the range of its corners take more.
    const bool near = std::abs(map.depth[i] - before.depth[i]) < 1e-5 * before.depth[i];
    clamped += !near;
    EXPECT_NEAR(map.depth[i], before.depth[i], 0.1);
  }
  EXPECT_GT(shown, 10000);
  EXPECT_LT(clamped, shown / 100);
}

TEST(DepthUpdate, FacesThatLoseTheirAreaStayWithinTheirCorners) {
  PosedCamera camera;
  camera.intrinsics = {64, 48, 50, 50, 32, 24};
  TriangleMesh mesh;
  mesh.vertices = {{-3, -3, 10}, {3, -3, 10}, {0, 3, 10}, {-90, -60, 20}, {90, -60, 20}, {0, 200, 20}};
  mesh.faces = {{0, 1, 2}, {3, 4, 5}};
  Rasterizer rasterizer;
  FaceMap map;
  rasterizer.Draw(mesh, nullptr, camera, &map);
  const FaceMap before = map;
  ASSERT_NE(std::count(map.face.begin(), map.face.end(), 0), 0);
  // The first face turns edge-on, along rays; the second comes to reach behind the camera.
  mesh.vertices[0] = {0, -2.5, 12.5};
  mesh.vertices[1] = {0, -2, 10};
  mesh.vertices[2] = {0, 2, 10};
  mesh.vertices[5] = {0, 150, -4};
  rasterizer.UpdateDepth(mesh, camera, &map);
  for (size_t i = 0; i < map.face.size(); ++i) {
    if (map.face[i] == 0) {
      EXPECT_GE(map.depth[i], 10 * (1 - 1e-6));
      EXPECT_LE(map.depth[i], 12.5 * (1 + 1e-6));
    }
    if (map.face[i] == 1) {
      EXPECT_GT(map.depth[i], 0);
      EXPECT_LE(map.depth[i], 20 * (1 + 1e-6));
    }
    if (map.face[i] < 0) {
      EXPECT_EQ(map.depth[i], before.depth[i]);
    }
  }
}

TEST(DepthUpdate, DoesNotDependOnThreads) {
  const PosedCamera camera = Oblique();
  TriangleMesh mesh = Grid(40, 60, 4, 2);
  FaceMap start;
  Rasterizer().Draw(mesh, nullptr, camera, &start);
  for (Vector3d& v : mesh.vertices) v.z() += 0.02 * std::sin(v.x());
  FaceMap one = start, many = start;
  {
    const ThreadLimit limit(1);
    Rasterizer().UpdateDepth(mesh, camera, &one);
  }
  {
    const ThreadLimit limit(4);
    Rasterizer().UpdateDepth(mesh, camera, &many);
  }
  EXPECT_NE(one.depth, start.depth);
  EXPECT_EQ(one.depth, many.depth);
}

}  // namespace
}  // namespace tessera
