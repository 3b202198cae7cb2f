#include "worker/tile/repair_tile.h"

#include <gtest/gtest.h>

#include <cmath>

#include "common/base/random.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

// Two long sheets, one above the other.
TriangleMesh Sheets(int nx, int ny, double gap_m, Random& random) {
  TriangleMesh mesh;
  for (int sheet = 0; sheet < 2; ++sheet) {
    const auto base = static_cast<uint32_t>(mesh.vertices.size());
    for (int y = 0; y <= ny; ++y) {
      for (int x = 0; x <= nx; ++x) {
        mesh.vertices.push_back({x + 0.2 * random.Uniform(), y + 0.2 * random.Uniform(), gap_m * sheet});
      }
    }
    const auto at = [&](int x, int y) { return base + static_cast<uint32_t>(y * (nx + 1) + x); };
    for (int y = 0; y < ny; ++y) {
      for (int x = 0; x < nx; ++x) {
        mesh.faces.push_back({at(x, y), at(x + 1, y), at(x + 1, y + 1)});
        mesh.faces.push_back({at(x, y), at(x + 1, y + 1), at(x, y + 1)});
      }
    }
  }
  return mesh;
}

// Repair of a strip's end equals the repair of the whole strip.
TEST(RepairCore, GivesTheCoreTheBytesOfTheWholeRegion) {
  int64_t changed = 0, elsewhere = 0, whole_differs = 0;
  for (uint64_t seed = 0; seed < 8; ++seed) {
    Random random(seed);
    RegionMesh region;
    region.surface = Sheets(260, 5, 0.5, random);
    const TriangleMesh& mesh = region.mesh();
    const Vector3d up = Vector3d::UnitZ();
    StepperOptions options;
    std::vector<Vector3d> good, proposed;
    for (const Vector3d& v : mesh.vertices) {
      good.push_back(v + 0.02 * Vector3d(random.Uniform(), random.Uniform(), random.Uniform()));
      const double push = random.Uniform() < 0.06 ? random.Uniform(-0.8, 0.8) : 0;
      proposed.push_back(good.back() + Vector3d(0.1 * push, 0.1 * push, push));
    }
    // The core is in the lower sheet; only contacts connect it to the upper one.
    std::vector<uint8_t> core;
    for (const Triangle& face : mesh.faces) {
      core.push_back(core.size() < mesh.faces.size() / 2 && mesh.vertices[face[0]].x() < 40);
    }
    std::vector<Vector3d> whole = proposed, part = proposed, kept = proposed;
    constexpr double kGsd_m = 0.5;
    Stepper(mesh, {}, {}, kGsd_m, up, options).Repair(good, &whole);
    const CoreRepair of_part = RepairCore(region, core, kGsd_m, options, good, &part);
    std::vector<uint8_t> own(mesh.vertices.size(), 0);
    for (size_t f = 0; f < core.size(); ++f) {
      for (const uint32_t v : mesh.faces[f]) own[v] |= core[f];
    }
    RegionRepair repair(region, MakeMotionLimits(options, kGsd_m));
    for (int level = 0; level < 2; ++level) {
      kept = proposed;
      EXPECT_EQ(RepairWithKept(repair, region, core, options, good, &kept).left_faces, of_part.left_faces);
      whole_differs += kept != whole;
      for (size_t v = 0; v < own.size(); ++v) {
        if (!own[v]) continue;
        ASSERT_EQ(kept[v], whole[v]) << "seed " << seed << ", level " << level << ", vertex " << v;
      }
    }
    for (size_t v = 0; v < own.size(); ++v) {
      if (own[v]) {
        ASSERT_EQ(part[v], whole[v]) << "seed " << seed << ", vertex " << v;
        changed += whole[v] != proposed[v];
      } else {
        elsewhere += part[v] != whole[v];
      }
    }
  }
  EXPECT_GT(changed, 50);
  EXPECT_GT(elsewhere, 100) << "the core is the whole region";
  EXPECT_GT(whole_differs, 0) << "the kept repair tests all faces";
}

}  // namespace
}  // namespace tessera
