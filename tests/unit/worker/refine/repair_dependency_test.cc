// Dependency radius of the repair of a vertex: a mesh cut at the radius, and a mesh changed at random everywhere
// outside it, give the same bytes as the whole. Random reliefs, settings and cores.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>

#include "common/base/random.h"
#include "tests/unit/worker/refine/random_reliefs.h"
#include "worker/refine/descent.h"
#include "worker/refine/self_intersection.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

// Overlapping sheets and a motion that makes them intersect.
struct RepairInput {
  TriangleMesh start;
  Positions good, proposed;
  MotionLimits limits;

  SurfaceRepair::Result Run(Positions* out) const {
    const MotionGuard guard(start, {}, limits);
    const auto keeps_facing = [&](uint32_t face, const auto& from, const auto& to) {
      return guard.KeepsOrientation(face, from, to);
    };
    *out = proposed;
    return SurfaceRepair(start, guard.faces_of_vertex()).Run(good, keeps_facing, out);
  }
};

RepairInput RandomRepair(Random& random) {
  RepairInput in;
  const int ny = 2 + static_cast<int>(random.Below(5)), nx = 160 + static_cast<int>(random.Below(100));
  const int sheets = 1 + static_cast<int>(random.Below(3));
  const double gap = random.Uniform(0.1, 1), rough = random.Uniform(0, 0.15);
  for (int sheet = 0; sheet < sheets; ++sheet) {
    TriangleMesh mesh = RandomRelief(nx, ny, random);
    const auto base = static_cast<uint32_t>(in.start.vertices.size());
    for (int y = 0, v = 0; y <= ny; ++y) {
      for (int x = 0; x <= nx; ++x, ++v) {
        mesh.vertices[v] = Vector3d(x + 0.3 * sheet, y, gap * sheet + std::sin(0.3 * x)) + rough * RandomVector(random);
      }
    }
    in.start.vertices.insert(in.start.vertices.end(), mesh.vertices.begin(), mesh.vertices.end());
    for (const Triangle& f : mesh.faces) in.start.faces.push_back({f[0] + base, f[1] + base, f[2] + base});
  }
  in.limits.start_smoothing_steps = static_cast<int>(random.Below(4));
  // Smooth motion with rough spots.
  const double wave = random.Uniform(0.1, 0.5), height = Magnitude(random, 0.1, 2),
               noise = Magnitude(random, 0.01, 0.3);
  const double places = Chance(random, 0.5) ? 0.01 : 0.1, rougher = Magnitude(random, 0.1, 2);
  for (const Vector3d& v : in.start.vertices) {
    in.good.push_back(v + 0.01 * RandomVector(random));
    const double lift = height * std::sin(wave * v.x() + 2 * v.z());
    Vector3d to = in.good.back() + Vector3d(0, 0, lift) + noise * RandomVector(random);
    if (Chance(random, places)) to += rougher * RandomVector(random);
    in.proposed.push_back(Chance(random, 0.02) ? in.good.back() : to);
  }
  return in;
}

// The faces within SurfaceRepair's dependency radius of the flagged vertices, as documented in its header, and those
// whose start positions the face test reads.
std::vector<uint8_t> RepairDependency(const RepairInput& in, std::vector<uint8_t> needed, int contacts_less) {
  const std::vector<Triangle>& faces = in.start.faces;
  const CsrRows faces_of_vertex = FacesOfVertices(in.start);
  std::vector<Eigen::AlignedBox3d> box(faces.size());
  for (size_t f = 0; f < faces.size(); ++f) {
    for (uint32_t v : faces[f]) box[f].extend(in.good[v]).extend(in.proposed[v]);
    box[f].min().array() -= 1e-9;
    box[f].max().array() += 1e-9;
  }
  std::vector<uint32_t> by_x(faces.size());
  std::iota(by_x.begin(), by_x.end(), 0u);
  const auto low = [&](uint32_t f) { return box[f].min().x(); };
  std::sort(by_x.begin(), by_x.end(), [&](uint32_t a, uint32_t b) { return low(a) < low(b); });
  double widest = 0;
  for (const auto& b : box) widest = std::max(widest, b.sizes().x());
  std::vector<uint8_t> needed_faces(faces.size()), asked(faces.size());
  for (size_t pass = SurfaceRepair::kPasses.size(); pass-- > 0;) {
    const int rings = SurfaceRepair::RingsOf(SurfaceRepair::kPasses[pass]);
    needed_faces = FacesWithin(faces, RingsFrom(faces, faces_of_vertex, needed), rings);
    if (static_cast<int>(pass) >= contacts_less) {
      const std::vector<uint8_t> before = needed_faces;
      for (size_t f = 0; f < faces.size(); ++f) {
        if (!before[f] || asked[f]) continue;
        asked[f] = 1;
        const auto begin = std::lower_bound(by_x.begin(), by_x.end(), box[f].min().x() - widest,
                                            [&](uint32_t g, double x) { return low(g) < x; });
        for (auto g = begin; g != by_x.end() && low(*g) <= box[f].max().x(); ++g) {
          needed_faces[*g] |= box[f].intersects(box[*g]);
        }
      }
    }
    needed = CornersOf(faces, needed_faces, needed.size());
  }
  if (in.limits.start_smoothing_steps == 0) return needed_faces;
  return FacesWithin(faces, RingsFrom(faces, faces_of_vertex, needed), in.limits.start_smoothing_steps - 1);
}

struct RepairRuns {
  int64_t cut = 0, changed = 0;
  int ending_inside = 0, repaired = 0;
};
RepairRuns BeyondRepair(uint64_t seeds, int contacts_less) {
  RepairRuns runs;
  for (uint64_t seed = 0; seed < seeds; ++seed) {
    Random random(seed);
    const RepairInput in = RandomRepair(random);
    std::vector<uint8_t> core = RandomCore(in.start, FacesOfVertices(in.start), random);
    Positions whole;
    in.Run(&whole);
    const std::vector<uint8_t> needed_faces = RepairDependency(in, core, contacts_less);
    if (std::count(needed_faces.begin(), needed_faces.end(), 0) == 0) continue;
    ++runs.ending_inside;
    for (size_t v = 0; v < core.size(); ++v) {
      if (core[v] && whole[v] != in.proposed[v]) {
        ++runs.repaired;
        break;
      }
    }
    const Part part(in.start, needed_faces);
    const RepairInput small{part.Mesh(in.start), part.OfVertices(in.good), part.OfVertices(in.proposed), in.limits};
    Positions out;
    small.Run(&out);
    runs.cut += Differences(whole, out, &part, core) > 0;

    RepairInput other = in;
    const std::vector<uint8_t> corners = CornersOf(in.start.faces, needed_faces, core.size());
    for (size_t v = 0; v < core.size(); ++v) {
      if (corners[v]) continue;
      other.start.vertices[v] += 0.05 * RandomVector(random);
      other.good[v] += 0.05 * RandomVector(random);
      other.proposed[v] += 0.3 * RandomVector(random);
    }
    // The contacts must be unchanged.
    if (contacts_less == 0 && RepairDependency(other, core, 0) != needed_faces) continue;
    other.Run(&out);
    runs.changed += Differences(whole, out, nullptr, core) > 0;
  }
  return runs;
}

TEST(SurfaceRepair, DependsOnNothingOutsideTheRadius) {
  const RepairRuns runs = BeyondRepair(60, 0);
  EXPECT_EQ(runs.cut, 0);
  EXPECT_EQ(runs.changed, 0);
  EXPECT_GT(runs.ending_inside, 40);
  EXPECT_GT(runs.repaired, 20);
}

TEST(SurfaceRepair, ContactsArePartOfTheRadius) {
  EXPECT_GT(BeyondRepair(20, static_cast<int>(SurfaceRepair::kPasses.size())).cut, 4);
}

// The number of rings per pass is attained: a spike through the sheet above, which one pass separates.
TEST(SurfaceRepair, RadiusOfAPassIsAttained) {
  RepairInput in;
  in.start = HeightField(40, 20, [](double, double) { return 0.0; });
  const size_t sheet = in.start.vertices.size();
  for (size_t v = 0; v < sheet; ++v) in.start.vertices.push_back(in.start.vertices[v] + Vector3d(0.2, 0.3, 1));
  for (size_t f = 0, count = in.start.faces.size(); f < count; ++f) {
    const auto [a, b, c] = in.start.faces[f];
    const auto up = static_cast<uint32_t>(sheet);
    in.start.faces.push_back({a + up, b + up, c + up});
  }
  in.good = in.proposed = in.start.vertices;
  for (size_t v = 0; v < sheet; ++v) in.proposed[v].z() += 0.01;
  const size_t spike = 20 * 41 + 20;
  in.proposed[spike].z() = 1.3;
  Positions out;
  const SurfaceRepair::Result result = in.Run(&out);
  ASSERT_TRUE(result.left.empty());
  ASSERT_EQ(result.passes, 1);
  const CsrRows faces_of_vertex = FacesOfVertices(in.start);
  std::vector<uint8_t> corners(in.start.vertices.size());
  for (uint32_t f : faces_of_vertex[spike]) {
    for (uint32_t v : in.start.faces[f]) corners[v] = 1;
  }
  const std::vector<int> rings = RingsFrom(in.start.faces, faces_of_vertex, corners);
  int farthest = 0;
  for (size_t v = 0; v < sheet; ++v) {
    if (out[v] != in.proposed[v]) farthest = std::max(farthest, rings[v]);
  }
  EXPECT_EQ(farthest, SurfaceRepair::kPasses[0].rings - 1);
}

}  // namespace
}  // namespace tessera
