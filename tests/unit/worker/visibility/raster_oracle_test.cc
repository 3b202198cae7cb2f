// Compares the rasteriser with brute force: every face at every pixel centre, in integers.
#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <vector>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "tests/support/draw_views.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

constexpr int64_t kUnit = 1 << 15;  // grid units a pixel, as rasterizer.h promises

// Camera at the origin along +z. Its parameters are powers of two: multiples of 2^-12 pixel at depth 2^k project
// exactly.
PosedCamera PlainCamera(int width, int height) {
  PosedCamera camera;
  camera.intrinsics = {width, height, 128, 128, 0.5 * width, 0.5 * height};
  return camera;
}

// The point that projects to (x, y) pixels at depth z.
Vector3d Unproject(const PosedCamera& camera, double x, double y, double z) {
  const PinholeCamera& k = camera.intrinsics;
  return {(x - k.cx) / k.fx * z, (y - k.cy) / k.fy * z, z};
}

struct GridCorner {
  int64_t x, y;
  double inverse_z;
};

GridCorner ToGrid(const PosedCamera& camera, const Vector3d& p) {
  const Vector3d seen = camera.Project(p);
  return {std::llrint(seen.x() * kUnit), std::llrint(seen.y() * kUnit), 1 / seen.z()};
}

// Depth of the face at a pixel's centre; none where the face does not cover it. Requires all corners in front of the
// camera.
std::optional<double> DepthAt(const GridCorner (&corner)[3], int column, int row) {
  const __int128 px = column * kUnit + kUnit / 2, py = row * kUnit + kUnit / 2;
  __int128 area[3], total = 0;
  for (int i = 0; i < 3; ++i) {
    const GridCorner& a = corner[(i + 1) % 3];
    const GridCorner& b = corner[(i + 2) % 3];
    area[i] = (a.x - px) * (b.y - py) - (a.y - py) * (b.x - px);
    total += area[i];
  }
  if (total == 0) return std::nullopt;
  const int sign = total > 0 ? 1 : -1;
  for (int i = 0; i < 3; ++i) {
    const GridCorner& a = corner[(i + 1) % 3];
    const GridCorner& b = corner[(i + 2) % 3];
    const int64_t right = sign * (a.y - b.y), below = sign * (b.x - a.x);
    const bool owns = right > 0 || (right == 0 && below > 0);
    if (sign * area[i] < 0 || (area[i] == 0 && !owns)) return std::nullopt;
  }
  double inverse_z = 0;
  for (int i = 0; i < 3; ++i) {
    inverse_z += static_cast<double>(area[i]) / static_cast<double>(total) * corner[i].inverse_z;
  }
  return 1 / inverse_z;
}

struct Corners {
  GridCorner corner[3];
};

std::vector<Corners> AllCorners(const TriangleMesh& mesh, const PosedCamera& camera) {
  std::vector<Corners> out;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    out.push_back(
        {{ToGrid(camera, mesh.Corner(f, 0)), ToGrid(camera, mesh.Corner(f, 1)), ToGrid(camera, mesh.Corner(f, 2))}});
  }
  return out;
}

// Checks every pixel. Faces whose depths differ by less than float precision may be exchanged, unless they have the
// same three vertices: then the first must win. Returns how many pixels show a face.
int ExpectAgrees(const FaceMap& map, const TriangleMesh& mesh, const PosedCamera& camera) {
  constexpr double kRounding = 4e-7;
  const std::vector<Corners> faces = AllCorners(mesh, camera);
  int shown = 0;
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      const size_t i = static_cast<size_t>(y) * map.width + x;
      double depth = FaceMap::kNothing;
      for (const Corners& f : faces) depth = std::min(depth, DepthAt(f.corner, x, y).value_or(depth));
      if (std::isinf(depth)) {
        EXPECT_EQ(map.face[i], -1) << x << " " << y;
        EXPECT_EQ(map.depth[i], FaceMap::kNothing) << x << " " << y;
        continue;
      }
      EXPECT_NEAR(map.depth[i], depth, kRounding * depth) << x << " " << y;
      EXPECT_GE(map.face[i], 0) << x << " " << y;
      if (map.face[i] < 0) continue;
      ++shown;
      const size_t f = static_cast<size_t>(map.face[i]);
      const std::optional<double> own = DepthAt(faces[f].corner, x, y);
      EXPECT_TRUE(own.has_value()) << "face " << f << " does not cover " << x << " " << y;
      if (!own) continue;
      EXPECT_LE(*own, depth * (1 + kRounding)) << x << " " << y;
      for (size_t g = 0; g < f; ++g) EXPECT_NE(mesh.faces[g], mesh.faces[f]) << g << " hides behind its copy " << f;
    }
  }
  return shown;
}

// Faces of every size in front of the camera, from far below a pixel to far beyond the image border. Some have
// corners on pixel centres, some are degenerate, some occur twice.
TriangleMesh Soup(const PosedCamera& camera, int count, uint64_t seed) {
  Random random(seed);
  const auto between = [&](double low, double high) { return low + (high - low) * random.Uniform(); };
  const auto exactly = [&](double value, double step) { return std::round(value / step) * step; };
  TriangleMesh mesh;
  const int width = camera.intrinsics.width, height = camera.intrinsics.height;
  for (int f = 0; f < count; ++f) {
    const double size = std::exp2(between(-5, 4)), x = between(-4, width + 4), y = between(-4, height + 4);
    const bool on_centres = f % 3 == 1, flat = f % 7 == 2, far = f % 97 == 5, line = f % 11 == 3;
    const uint32_t first = static_cast<uint32_t>(mesh.vertices.size());
    for (int c = 0; c < 3; ++c) {
      const double reach = far ? 3000 : size;
      double u = x + reach * between(-1, 1), v = y + reach * between(-1, 1);
      if (on_centres) {
        u = std::floor(u) + 0.5;
        v = std::floor(v) + 0.5;
      }
      if (line) v = y + 0.5 * (u - x);
      // Large faces are far away, else they would hide most others.
      const double z = far ? between(200, 600)
                           : (flat ? 64 : (on_centres ? std::exp2(exactly(between(4, 8), 1)) : between(20, 200)));
      mesh.vertices.push_back(Unproject(camera, u, v, z));
    }
    mesh.faces.push_back({first, first + 1, first + 2});
    if (f % 13 == 4) mesh.faces.push_back(mesh.faces.back());
  }
  return mesh;
}

TEST(RasterOracle, MatchesBruteForceOnRandomTriangles) {
  for (uint64_t seed = 1; seed <= 6; ++seed) {
    // Widths that no vector width divides, and one less than a vector.
    const PosedCamera camera = PlainCamera(seed == 6 ? 3 : 37 + 5 * static_cast<int>(seed), 41);
    const TriangleMesh mesh = Soup(camera, 300, seed);
    const FaceMap map = RasterizeFaces(mesh, camera);
    EXPECT_GT(ExpectAgrees(map, mesh, camera), map.width * map.height / 4) << "seed " << seed;
    if (HasFailure()) return;
  }
}

// A patch of random triangles with shared vertices, most of which lie on pixel centres or in the same column.
TEST(RasterOracle, SharedEdgesLeaveNoHolesAndNoOverlaps) {
  Random random(5);
  const PosedCamera camera = PlainCamera(48, 48);
  constexpr int kSide = 24;
  TriangleMesh mesh;
  for (int y = 0; y <= kSide; ++y) {
    for (int x = 0; x <= kSide; ++x) {
      const bool rim = x == 0 || y == 0 || x == kSide || y == kSide;
      const double step = random.Uniform() < 0.5 ? 1.0 : 0.25;
      const auto shift = [&] { return rim ? 0.0 : step * std::floor(1.6 / step * (random.Uniform() - 0.5)); };
      mesh.vertices.push_back(Unproject(camera, 2 * x + 0.5 + shift(), 2 * y + 0.5 + shift(), 64));
    }
  }
  for (uint32_t y = 0; y < kSide; ++y) {
    for (uint32_t x = 0; x < kSide; ++x) {
      const uint32_t a = y * (kSide + 1) + x, b = a + 1, c = a + kSide + 1, d = c + 1;
      if (random.Uniform() < 0.5) {
        mesh.faces.insert(mesh.faces.end(), {{a, b, c}, {b, d, c}});
      } else {
        mesh.faces.insert(mesh.faces.end(), {{a, b, d}, {d, c, a}});
      }
    }
  }
  const std::vector<Corners> corners = AllCorners(mesh, camera);
  std::vector<int> expected(48 * 48), drawn(48 * 48);
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const FaceMap map = RasterizeFaces({mesh.vertices, {mesh.faces[f]}, {}}, camera);
    for (int i = 0; i < 48 * 48; ++i) {
      drawn[i] += map.face[i] == 0;
      expected[i] += DepthAt(corners[f].corner, i % 48, i / 48).has_value();
    }
  }
  EXPECT_EQ(drawn, expected);
  // The random shifts may fold some cells; without folds every pixel has exactly one face.
  int once = 0;
  for (int count : drawn) {
    EXPECT_GE(count, 1);
    once += count == 1;
  }
  EXPECT_GT(once, 48 * 48 * 3 / 4);
}

TEST(RasterOracle, LowestIndexWinsAmongEquallyDeepFaces) {
  const PosedCamera camera = PlainCamera(40, 30);
  Random random(3);
  TriangleMesh mesh;  // all at one depth
  for (uint32_t f = 0; f < 200; ++f) {
    const double x = 40 * random.Uniform(), y = 30 * random.Uniform(), size = f % 2 == 0 ? 1 : 12;
    for (int c = 0; c < 3; ++c) {
      mesh.vertices.push_back(Unproject(camera, x + size * random.Uniform(), y + size * random.Uniform(), 64));
    }
    mesh.faces.push_back({3 * f, 3 * f + 1, 3 * f + 2});
  }
  const std::vector<Corners> corners = AllCorners(mesh, camera);
  const FaceMap map = RasterizeFaces(mesh, camera);
  for (int i = 0; i < 40 * 30; ++i) {
    int first = -1;
    for (int f = 199; f >= 0; --f) {
      if (DepthAt(corners[f].corner, i % 40, i / 40)) first = f;
    }
    ASSERT_EQ(map.face[i], first) << i;
  }
}

// Nearest intersection beyond the near plane of the ray through a pixel's centre (Möller and Trumbore), and whether
// it is unambiguous: the ray is not close to an edge, to another face's intersection, or to the near plane.
struct RayHit {
  int face = -1;
  double depth = FaceMap::kNothing;
  bool clear = true;
};

RayHit TracePixel(const TriangleMesh& mesh, const PosedCamera& camera, int column, int row, double near_m) {
  const Vector3d origin = camera.Centre(), d = camera.Ray(column + 0.5, row + 0.5);
  RayHit best;
  std::vector<double> depths;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Vector3d a = mesh.Corner(f, 0), e1 = mesh.Corner(f, 1) - a, e2 = mesh.Corner(f, 2) - a;
    const Vector3d p = d.cross(e2), t = origin - a, q = t.cross(e1);
    const double det = e1.dot(p), u = t.dot(p) / det, v = d.dot(q) / det, s = e2.dot(q) / det;
    const double margin = std::min({u, v, 1 - u - v});
    if (!(std::abs(det) > 0) || margin < -1e-3 || s < 0.9 * near_m) continue;
    if (std::abs(margin) < 1e-3 || std::abs(s - near_m) < 0.1 * near_m) best.clear = false;
    if (margin < 0 || s < near_m) continue;
    depths.push_back(s);
    if (s < best.depth) {
      best.depth = s;
      best.face = static_cast<int>(f);
    }
  }
  for (double depth : depths) best.clear = best.clear && (depth == best.depth || depth > 1.0001 * best.depth);
  return best;
}

// Faces around the camera, most of them partly behind it or outside the image.
TriangleMesh Surroundings(int count, uint64_t seed) {
  Random random(seed);
  TriangleMesh mesh;
  for (uint32_t f = 0; f < static_cast<uint32_t>(count); ++f) {
    const double size = std::exp2(8 * random.Uniform() - 2);
    for (int c = 0; c < 3; ++c) {
      mesh.vertices.push_back(
          {size * (random.Uniform() - 0.5), size * (random.Uniform() - 0.5), size * (random.Uniform() - 0.4)});
    }
    mesh.faces.push_back({3 * f, 3 * f + 1, 3 * f + 2});
  }
  return mesh;
}

TEST(RasterOracle, MatchesRayCastingForFacesAcrossTheNearPlane) {
  for (uint64_t seed = 1; seed <= 4; ++seed) {
    const PosedCamera camera = PlainCamera(64, 48);
    const TriangleMesh mesh = Surroundings(40, seed);
    for (double near_m : {1e-3, 0.5}) {
      const FaceMap map = RasterizeFaces(mesh, camera, near_m);
      int clear = 0, seen = 0;
      for (int i = 0; i < 64 * 48; ++i) {
        const RayHit hit = TracePixel(mesh, camera, i % 64, i / 64, near_m);
        if (!hit.clear) continue;
        ++clear;
        seen += hit.face >= 0;
        ASSERT_EQ(map.face[i], hit.face) << "seed " << seed << " pixel " << i;
        if (hit.face >= 0) {
          ASSERT_NEAR(map.depth[i], hit.depth, 2e-4 * hit.depth);
        }
      }
      EXPECT_GT(clear, 64 * 48 * 3 / 4);
      EXPECT_GT(seen, 64 * 48 / 2);
    }
  }
}

size_t FacesShown(const FaceMap& map) {
  std::vector<int32_t> faces = map.face;
  std::sort(faces.begin(), faces.end());
  return static_cast<size_t>(std::unique(faces.begin(), faces.end()) - faces.begin());
}

bool SameBytes(const FaceMap& a, const FaceMap& b) {
  return a.width == b.width && a.height == b.height && a.face == b.face && a.depth.size() == b.depth.size() &&
         std::memcmp(a.depth.data(), b.depth.data(), a.depth.size() * sizeof(float)) == 0;
}

// More triangles than one band or one list holds; some cross the near plane, most are visible.
TriangleMesh LargeSoup(const PosedCamera& camera) {
  TriangleMesh mesh = Soup(camera, 12000, 9);
  const TriangleMesh around = Surroundings(6, 2);
  const uint32_t first = static_cast<uint32_t>(mesh.vertices.size());
  for (const Vector3d& v : around.vertices) mesh.vertices.push_back(80 * v);
  for (const Triangle& face : around.faces) {
    mesh.faces.insert(mesh.faces.begin() + 300 * (face[0] / 3), {face[0] + first, face[1] + first, face[2] + first});
  }
  return mesh;
}

TEST(RasterOracle, ResultIsIndependentOfThreadsBatchingAndReusedBuffers) {
  const PosedCamera camera = PlainCamera(301, 223), other = PlainCamera(90, 120);
  const TriangleMesh mesh = LargeSoup(camera), few = Soup(camera, 40, 4);
  FaceMap alone, alone_other;
  {
    const ThreadLimit limit(1);
    alone = RasterizeFaces(mesh, camera);
    alone_other = RasterizeFaces(few, other);
  }
  EXPECT_GT(FacesShown(alone), 2000u);
  // Cells of unequal size, not all of them in the window.
  MeshCells cells;
  for (uint32_t k = 0; k <= 50; ++k) {
    cells.face_begin.push_back(static_cast<uint32_t>(mesh.faces.size() * k * k / 2500));
    cells.vertex_begin.push_back(static_cast<uint32_t>(mesh.vertices.size() * k / 50));
  }
  cells.vertex_cells.resize(50);
  FindVertexCells(mesh.faces, &cells);
  const CellBoxes boxes(mesh, &cells);
  FaceMap alone_part;
  const CameraWindow part(camera, {64, 32, 90, 47}), whole_other(other);
  {
    const ThreadLimit limit(1);
    alone_part = RasterizeFaces(mesh, part);
  }
  for (int threads : {1, 2, 5, 16}) {
    const ThreadLimit limit(threads);
    Rasterizer rasterizer;
    std::vector<FaceMap> maps;
    DrawViews(few, CellBoxes(few), {&whole_other, 1}, &rasterizer, &maps);
    EXPECT_TRUE(SameBytes(maps[0], alone_other));
    for (size_t views : {1, 7}) {
      const std::vector<CameraWindow> cameras(views, CameraWindow(camera));
      DrawViews(mesh, boxes, cameras, &rasterizer, &maps);
      ASSERT_EQ(maps.size(), views);
      for (const FaceMap& each : maps) EXPECT_TRUE(SameBytes(each, alone)) << threads << " threads, " << views;
      DrawViews(mesh, boxes, std::vector<CameraWindow>(views, part), &rasterizer, &maps);
      for (const FaceMap& each : maps) EXPECT_TRUE(SameBytes(each, alone_part)) << threads << " threads, " << views;
    }
  }
}

TEST(RasterOracle, ResultIsIndependentOfTheInstructionSet) {
  const PosedCamera camera = PlainCamera(301, 223);
  const TriangleMesh mesh = LargeSoup(camera);
  const FaceMap best = RasterizeFaces(mesh, camera);
  EXPECT_GT(FacesShown(best), 2000u);
  for (int64_t target : {HWY_SCALAR, HWY_SSSE3, HWY_SSE4, HWY_AVX2}) {
    if (target != HWY_SCALAR && (hwy::SupportedTargets() & target) == 0) continue;
    hwy::GetChosenTarget().Update(target);
    EXPECT_TRUE(SameBytes(RasterizeFaces(mesh, camera), best)) << hwy::TargetName(target);
  }
  hwy::GetChosenTarget().DeInit();  // the next call chooses again
}

}  // namespace
}  // namespace tessera
