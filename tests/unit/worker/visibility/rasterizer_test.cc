#include "worker/visibility/rasterizer.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "tests/support/draw_views.h"
#include "worker/visibility/raster_kernel.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

PosedCamera LookingDown(double height_m, double tilt_rad = 0) {
  PosedCamera camera;
  camera.intrinsics = {160, 120, 150, 150, 80, 60};
  Eigen::Matrix3d down;
  down << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  Eigen::Matrix3d tilt;
  tilt << 1, 0, 0, 0, std::cos(tilt_rad), -std::sin(tilt_rad), 0, std::sin(tilt_rad), std::cos(tilt_rad);
  camera.rotation_cam_from_world = tilt * down;
  camera.translation_cam_from_world = -(camera.rotation_cam_from_world * Vector3d(0.3, -0.2, height_m));
  return camera;
}

// A bumpy square [-half, half]² of n x n cells.
TriangleMesh Terrain(int n, double half_m, double relief_m, uint64_t seed) {
  Random random(seed);
  TriangleMesh mesh;
  for (int y = 0; y <= n; ++y) {
    for (int x = 0; x <= n; ++x) {
      mesh.vertices.push_back({half_m * (2.0 * x / n - 1), half_m * (2.0 * y / n - 1), relief_m * random.Uniform()});
    }
  }
  const auto id = [&](int x, int y) { return static_cast<uint32_t>(y * (n + 1) + x); };
  for (int y = 0; y < n; ++y) {
    for (int x = 0; x < n; ++x) {
      mesh.faces.push_back({id(x, y), id(x + 1, y), id(x + 1, y + 1)});
      mesh.faces.push_back({id(x, y), id(x + 1, y + 1), id(x, y + 1)});
    }
  }
  return mesh;
}

// Nearest face along the pixel's ray by brute force in double (Möller and Trumbore); -1 and infinity if none.
std::pair<int, double> TraceRay(const TriangleMesh& mesh, const PosedCamera& camera, double x, double y) {
  const Vector3d origin = camera.Centre(), d = camera.Ray(x, y);
  std::pair<int, double> best{-1, std::numeric_limits<double>::infinity()};
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Vector3d a = mesh.Corner(f, 0), e1 = mesh.Corner(f, 1) - a, e2 = mesh.Corner(f, 2) - a;
    const Vector3d p = d.cross(e2);
    const double det = e1.dot(p);
    if (det == 0) continue;
    const Vector3d t = origin - a, q = t.cross(e1);
    const double u = t.dot(p) / det, v = d.dot(q) / det, s = e2.dot(q) / det;
    if (u < 0 || v < 0 || u + v > 1 || s <= 0 || s >= best.second) continue;
    best = {static_cast<int>(f), s};
  }
  return best;
}

TEST(Rasterizer, FacesOfGroupsThatAreNotSelectedHideWithoutTheirName) {
  TriangleMesh mesh = Terrain(24, 30, 8, 3);
  // Faces that reach behind the camera.
  const size_t bounded = mesh.faces.size();
  for (const double y : {-8.0, 8.0}) {
    const auto first = static_cast<uint32_t>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), {{-6, y, 5}, {6, y, 5}, {0, y, 400}});
    mesh.faces.push_back({first, first + 1, first + 2});
  }
  std::vector<uint32_t> groups;
  for (uint32_t f = 0; f < mesh.faces.size(); ++f) groups.push_back(f < bounded ? f % 3 : 1);
  const std::vector<uint8_t> selected = {1, 0, 1};
  const FaceSelection selection = {groups.data(), selected.data()};
  const CameraWindow window = LookingDown(60, 0.5);
  const MeshPart part = CellBoxes(mesh).InWindow(window, kNearPlane_m);
  for (const int threads : {1, 2}) {
    const ThreadLimit limit(threads);
    FaceMap all, some;
    Rasterizer rasterizer;
    rasterizer.DrawPart(mesh, part, window, &all, kNearPlane_m, {}, threads);
    rasterizer.DrawPart(mesh, part, window, &some, kNearPlane_m, selection, threads);
    int hidden = 0, unbounded = 0;
    for (size_t i = 0; i < all.face.size(); ++i) {
      const int32_t face = all.face[i];
      const bool named = face < 0 || groups[face] != 1;
      EXPECT_EQ(some.face[i], named ? face : kNotSelected);
      hidden += !named;
      unbounded += face >= static_cast<int32_t>(bounded);
    }
    EXPECT_EQ(some.depth, all.depth);
    EXPECT_GT(hidden, 1000);
    EXPECT_GT(unbounded, 10);
  }
}

TEST(Rasterizer, MatchesRayCasting) {
  const TriangleMesh mesh = Terrain(24, 30, 8, 3);
  const PosedCamera camera = LookingDown(60, 0.5);
  const FaceMap map = RasterizeFaces(mesh, camera);
  int different = 0, hits = 0;
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      const auto [face, depth] = TraceRay(mesh, camera, x + 0.5, y + 0.5);
      const size_t i = static_cast<size_t>(y) * map.width + x;
      hits += face >= 0;
      different += face != map.face[i];
      if (face == map.face[i] && face >= 0) {
        EXPECT_NEAR(map.depth[i], depth, 1e-5 * depth);
      }
    }
  }
  EXPECT_GT(hits, 5000);
  EXPECT_LE(different, 2);
}

TEST(Rasterizer, AdjacentFacesCoverEachPixelExactlyOnce) {
  // Vertices exactly on pixel centres: a flat grid whose edges run through them.
  TriangleMesh mesh = Terrain(32, 16, 0, 1);
  PosedCamera camera;
  camera.intrinsics = {64, 64, 64, 64, 32.5, 32.5};
  camera.rotation_cam_from_world << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  camera.translation_cam_from_world = Vector3d(0, 0, 32);
  const FaceMap together = RasterizeFaces(mesh, camera);
  std::vector<int> drawn(together.face.size());
  for (const Triangle& face : mesh.faces) {
    TriangleMesh one{mesh.vertices, {face}, {}};
    const FaceMap map = RasterizeFaces(one, camera);
    for (size_t i = 0; i < drawn.size(); ++i) drawn[i] += map.face[i] >= 0;
  }
  for (int y = 2; y < 62; ++y) {
    for (int x = 2; x < 62; ++x) {
      ASSERT_EQ(drawn[y * 64 + x], 1) << x << " " << y;
      ASSERT_GE(together.face[y * 64 + x], 0);
    }
  }
}

TEST(Rasterizer, ClipsFacesAtTheNearPlane) {
  // The camera stands on a plane that continues behind it.
  TriangleMesh mesh;
  mesh.vertices = {{-500, -500, -2}, {500, -500, -2}, {500, 500, -2}, {-500, 500, -2}};
  mesh.faces = {{0, 1, 2}, {0, 2, 3}};
  PosedCamera camera;
  camera.intrinsics = {100, 80, 90, 90, 50, 40};
  camera.rotation_cam_from_world << 1, 0, 0, 0, 0, -1, 0, 1, 0;  // looks along +y
  const FaceMap map = RasterizeFaces(mesh, camera);
  for (int x = 0; x < 100; ++x) {
    EXPECT_EQ(map.face[10 * 100 + x], -1);
    ASSERT_GE(map.face[70 * 100 + x], 0);
    EXPECT_NEAR(map.depth[70 * 100 + x], 2 * 90 / 30.5, 1e-4);
  }
}

TEST(Rasterizer, ResultIsIndependentOfThreads) {
  const TriangleMesh mesh = Terrain(60, 30, 5, 8);
  const PosedCamera camera = LookingDown(50, 0.4);
  FaceMap one, two;
  {
    ThreadLimit limit(1);
    one = RasterizeFaces(mesh, camera);
  }
  {
    ThreadLimit limit(2);
    two = RasterizeFaces(mesh, camera);
  }
  EXPECT_EQ(one.face, two.face);
  EXPECT_EQ(one.depth, two.depth);
}

TEST(Rasterizer, WindowEqualsThatPartOfTheWholeImage) {
  const TriangleMesh mesh = Terrain(20, 12, 4, 5);
  const PosedCamera camera = LookingDown(60, 0.3);
  PixelRect rect = {160, 120, 0, 0};  // all pixels that the mesh may cover, and three more each way
  for (const Vector3d& v : mesh.vertices) {
    const auto p = camera.Project(v);
    rect.x0 = std::max(0, std::min(rect.x0, static_cast<int>(p.x()) - 3));
    rect.y0 = std::max(0, std::min(rect.y0, static_cast<int>(p.y()) - 3));
    rect.x1 = std::min(160, std::max(rect.x1, static_cast<int>(p.x()) + 4));
    rect.y1 = std::min(120, std::max(rect.y1, static_cast<int>(p.y()) + 4));
  }
  EXPECT_LT(rect.width() * rect.height(), 160 * 120 / 2);
  const FaceMap whole = RasterizeFaces(mesh, camera);
  const FaceMap part = RasterizeFaces(mesh, CameraWindow(camera, rect));
  int inside = 0, total = 0;
  for (int32_t f : whole.face) total += f >= 0;
  for (int y = 0; y < part.height; ++y) {
    for (int x = 0; x < part.width; ++x) {
      const int32_t f = part.face[y * part.width + x];
      inside += f >= 0;
      const int in_whole = (y + rect.y0) * whole.width + x + rect.x0;
      ASSERT_EQ(f, whole.face[in_whole]);
      ASSERT_EQ(part.depth[y * part.width + x], whole.depth[in_whole]);
    }
  }
  EXPECT_EQ(inside, total);
}

TEST(PyramidCamera, KeepsPixelEdges) {
  PosedCamera camera = LookingDown(60, 0.3);
  camera.intrinsics.width = 161;
  const PosedCamera half = PyramidCamera(camera, 1);
  EXPECT_EQ(half.intrinsics.width, 80);
  const Vector3d p(1.3, 2.1, 0.4);
  EXPECT_NEAR(half.Project(p).x(), camera.Project(p).x() / 2, 1e-12);
  EXPECT_NEAR(half.Project(p).y(), camera.Project(p).y() / 2, 1e-12);
}

}  // namespace
}  // namespace tessera
