#include "worker/refine/self_intersection.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "tests/support/relief_scene.h"
#include "tests/unit/worker/refine/cgal_pairs.h"
#include "worker/refine/descent.h"

namespace tessera {
namespace {

using Eigen::Vector3d;
using Positions = std::vector<Vector3d>;

double Level(double, double) { return 0.0; }

TriangleMesh Joined(const TriangleMesh& a, const TriangleMesh& b) {
  TriangleMesh out = a;
  const auto base = static_cast<uint32_t>(a.vertices.size());
  out.vertices.insert(out.vertices.end(), b.vertices.begin(), b.vertices.end());
  for (const Triangle& f : b.faces) out.faces.push_back({f[0] + base, f[1] + base, f[2] + base});
  return out;
}

// Two sheets, the upper `gap_m` above the lower.
TriangleMesh Sheets(int n, double half_m, double gap_m) {
  return Joined(HeightField(n, half_m, Level), HeightField(n, half_m, [&](double, double) { return gap_m; }));
}

// A wall of thickness `thickness_m` on the ground, as one sheet that runs up, over and down.
TriangleMesh ThinWall(int n, double thickness_m) {
  TriangleMesh mesh = HeightField(n, 4, Level);
  for (Vector3d& v : mesh.vertices) {
    const double s = v.x();  // along the profile: ground, up 2 m, across, down 2 m, ground
    const double half = 0.5 * thickness_m;
    if (s < -2.2) {
      v = {s + 2.2 - half, v.y(), 0};
    } else if (s < -0.2) {
      v = {-half, v.y(), s + 2.2};
    } else if (s <= 0.2) {
      v = {half * s / 0.2, v.y(), 2};
    } else if (s <= 2.2) {
      v = {half, v.y(), 2.2 - s};
    } else {
      v = {s - 2.2 + half, v.y(), 0};
    }
  }
  return mesh;
}

void Roughen(TriangleMesh& mesh, double sigma, uint64_t seed) {
  Random random(seed);
  for (Vector3d& v : mesh.vertices) v += sigma * Vector3d(random.Normal(), random.Normal(), random.Normal());
}

TEST(IntersectingFacePairs, MatchCgal) {
  size_t found = 0;
  for (uint64_t seed = 0; seed < 12; ++seed) {
    TriangleMesh mesh = seed % 3 == 0 ? Sheets(14, 3, 0.1) : HeightField(20, 3, ReliefHeight);
    Roughen(mesh, 0.02 * static_cast<double>(seed), seed);
    for (Vector3d& v : mesh.vertices) v += Vector3d(5000, -300, 40);
    const std::vector<FacePair> pairs = IntersectingFacePairs(mesh);
    EXPECT_EQ(pairs, PairsByCgal(mesh)) << "seed " << seed;
    found += pairs.size();
  }
  EXPECT_GT(found, 1000u);
}

TEST(IntersectingFacePairs, MatchCgalOnDegenerateConfigurations) {
  // Few distinct coordinates: coplanar faces, touching edges, vertices on faces.
  size_t found = 0;
  for (uint64_t seed = 0; seed < 30; ++seed) {
    Random random(seed);
    TriangleMesh mesh = Sheets(6, 3, 1);
    for (Vector3d& v : mesh.vertices) {
      v += 0.5 * Vector3d(static_cast<double>(random.Below(4)), static_cast<double>(random.Below(3)),
                          static_cast<double>(random.Below(3)));
    }
    bool degenerate = false;
    for (size_t f = 0; f < mesh.faces.size(); ++f) degenerate |= FaceArea(mesh, f) < 1e-9;
    if (degenerate) {
      for (Vector3d& v : mesh.vertices) v.z() += 0.25 * v.x() * v.x() + 0.125 * v.x() * v.y();
    }
    for (size_t f = mesh.faces.size(); f-- > 0;) {
      if (FaceArea(mesh, f) < 1e-9) mesh.faces.erase(mesh.faces.begin() + static_cast<int64_t>(f));
    }
    const std::vector<FacePair> pairs = IntersectingFacePairs(mesh);
    EXPECT_EQ(pairs, PairsByCgal(mesh)) << "seed " << seed;
    found += pairs.size();
  }
  EXPECT_GT(found, 100u);
}

TEST(IntersectingFacePairs, FlatAndFoldedNeighbours) {
  EXPECT_TRUE(IntersectingFacePairs(HeightField(9, 3, Level)).empty());
  TriangleMesh folded = HeightField(1, 1, Level);  // 0 1 3, 0 3 2
  EXPECT_TRUE(IntersectingFacePairs(folded).empty());
  folded.vertices[2] = Vector3d(0.9, -0.8, 0);  // folded over onto the other face
  EXPECT_EQ(IntersectingFacePairs(folded), (std::vector<FacePair>{{0, 1}}));
  folded.vertices[2].z() = 1e-9;
  EXPECT_TRUE(IntersectingFacePairs(folded).empty());
}

TEST(FaceBoxes, ActiveFacesGiveTheSubsetOfAllPairs) {
  TriangleMesh mesh = Sheets(20, 3, 0.05);
  FaceBoxes boxes(mesh);
  Roughen(mesh, 0.05, 1);
  boxes.Refit(mesh);
  const std::vector<FacePair> all = IntersectingFacePairs(mesh);
  // Some faces; all but some; all of a part, where whole subtrees of boxes are active.
  const std::function<bool(uint32_t)> cases[] = {[](uint32_t f) { return f % 7 == 0; },
                                                 [](uint32_t f) { return f % 70 != 0; },
                                                 [&](uint32_t f) { return f > mesh.faces.size() / 3; }};
  for (const auto& is_active : cases) {
    std::vector<uint32_t> active;
    for (uint32_t f = 0; f < mesh.faces.size(); ++f) {
      if (is_active(f)) active.push_back(f);
    }
    std::vector<FacePair> expected;
    for (const FacePair& p : all) {
      if (is_active(p[0]) || is_active(p[1])) expected.push_back(p);
    }
    EXPECT_GT(expected.size(), 50u);
    EXPECT_EQ(boxes.Intersections(mesh, active), expected);
  }
}

// A start, a motion, and the repaired positions.
struct Repaired {
  TriangleMesh mesh;
  SurfaceRepair::Result result;
};
Repaired Repair(const TriangleMesh& start, const Positions& moved, const MotionGuard* guard) {
  const CsrRows faces_of_vertex = FacesOfVertices(start);
  SurfaceRepair repair(start, faces_of_vertex);
  Repaired out{{moved, start.faces, {}}, {}};
  SurfaceRepair::FaceTest test;
  if (guard) {
    test = [&](uint32_t face, const auto& from, const auto& to) { return guard->KeepsOrientation(face, from, to); };
  }
  out.result = repair.Run(start.vertices, test, &out.mesh.vertices);
  return out;
}

TEST(SurfaceRepair, DoesNotChangeACleanMotion) {
  const TriangleMesh start = Sheets(12, 3, 1);
  TriangleMesh moved = start;
  for (Vector3d& v : moved.vertices) v.z() += 0.3 * std::sin(v.x());
  const Repaired out = Repair(start, moved.vertices, nullptr);
  EXPECT_EQ(out.mesh.vertices, moved.vertices);
  EXPECT_EQ(out.result.passes, 0);
  EXPECT_EQ(out.result.changed_vertices, 0);
}

TEST(SurfaceRepair, SeparatesIntersectingSheets) {
  const TriangleMesh start = Sheets(40, 4, 0.3);
  TriangleMesh moved = start;
  const size_t half = start.vertices.size() / 2;
  for (size_t v = 0; v < moved.vertices.size(); ++v) {
    const Vector3d p = start.vertices[v];
    const double dent = 0.6 * std::exp(-(p.x() * p.x() + p.y() * p.y()));
    moved.vertices[v].z() += v < half ? dent : -dent;
  }
  moved.vertices[5].z() += 0.05;  // far away, must stay
  ASSERT_GT(IntersectingFacePairs(moved).size(), 50u);
  const Repaired out = Repair(start, moved.vertices, nullptr);
  EXPECT_TRUE(out.result.left.empty());
  EXPECT_TRUE(PairsByCgal(out.mesh).empty());
  EXPECT_EQ(out.mesh.vertices[5], moved.vertices[5]);
  double kept = 0, wanted = 0;
  for (size_t v = 0; v < half; ++v) {
    if (start.vertices[v].head<2>().norm() > 3) {
      EXPECT_EQ(out.mesh.vertices[v], moved.vertices[v]);
    }
    kept += out.mesh.vertices[v].z() - start.vertices[v].z();
    wanted += moved.vertices[v].z() - start.vertices[v].z();
  }
  EXPECT_GT(kept, 0.15 * wanted);  // motion without intersections is partly kept
}

TEST(SurfaceRepair, KeepsThinWallsApart) {
  for (const double thickness : {0.3, 0.05, 0.002}) {
    const TriangleMesh start = ThinWall(40, thickness);
    ASSERT_TRUE(PairsByCgal(start).empty());
    TriangleMesh moved = start;
    Roughen(moved, 0.08, 5);
    ASSERT_FALSE(PairsByCgal(moved).empty());
    const MotionGuard guard(start, {}, {});
    const Repaired out = Repair(start, moved.vertices, &guard);
    EXPECT_TRUE(out.result.left.empty());
    EXPECT_TRUE(PairsByCgal(out.mesh).empty()) << thickness;
    EXPECT_EQ(guard.InvertedFaces(out.mesh.vertices), guard.InvertedFaces(start.vertices)) << thickness;
  }
}

TEST(SurfaceRepair, UnfoldsFans) {
  const TriangleMesh start = HeightField(12, 3, Level);
  TriangleMesh moved = start;
  moved.vertices[6 * 13 + 6] += Vector3d(1.2, 0.9, 0);  // beyond its ring, in the plane: overlap and inverted faces
  moved.vertices[3 * 13 + 3] += Vector3d(-0.8, 0.1, 0.02);
  const MotionGuard guard(start, {}, {});
  ASSERT_GT(guard.InvertedFaces(moved.vertices), 0);
  const Repaired out = Repair(start, moved.vertices, &guard);
  EXPECT_EQ(guard.InvertedFaces(out.mesh.vertices), 0);
  EXPECT_TRUE(PairsByCgal(out.mesh).empty());
  EXPECT_NE(out.mesh.vertices[6 * 13 + 6], start.vertices[6 * 13 + 6]);
}

TEST(SurfaceRepair, AcceptsIntersectionsOfTheStart) {
  TriangleMesh start = Sheets(20, 3, 0.1);
  start.vertices[21 * 10 + 10].z() = 0.3;  // the lower sheet pierces the upper one
  const std::vector<FacePair> before = PairsByCgal(start);
  ASSERT_FALSE(before.empty());
  TriangleMesh moved = start;
  for (Vector3d& v : moved.vertices) v.z() += 0.5;
  EXPECT_EQ(Repair(start, moved.vertices, nullptr).result.changed_vertices, 0);
  moved.vertices[21 * 4 + 4].z() += 0.3;  // a second intersection, not in the start
  const Repaired out = Repair(start, moved.vertices, nullptr);
  EXPECT_GT(out.result.changed_vertices, 0);
  EXPECT_TRUE(NewPairs(before, PairsByCgal(out.mesh)).empty());
}

// Moving back cannot separate them.
TEST(SurfaceRepair, AcceptsIntersectionsFromBeforeTheStage) {
  const TriangleMesh start = Sheets(20, 3, 0.1);
  ASSERT_TRUE(PairsByCgal(start).empty());
  TriangleMesh good = start;
  good.vertices[21 * 10 + 10].z() = 0.3;
  ASSERT_FALSE(PairsByCgal(good).empty());
  std::vector<Vector3d> moved = good.vertices;
  for (Vector3d& v : moved) v.z() += 0.5;
  const std::vector<Vector3d> wanted = moved;
  const CsrRows faces_of_vertex = FacesOfVertices(start);
  const SurfaceRepair::Result result = SurfaceRepair(start, faces_of_vertex).Run(good.vertices, nullptr, &moved);
  EXPECT_EQ(moved, wanted);
  EXPECT_TRUE(result.left.empty());
}

TEST(SurfaceRepair, TerminatesForAnyMotionIndependentOfThreads) {
  for (const double sigma : {0.05, 0.3, 2.0}) {
    const TriangleMesh start = Joined(ThinWall(20, 0.1), HeightField(20, 4, [](double, double) { return -0.2; }));
    ASSERT_TRUE(PairsByCgal(start).empty());
    TriangleMesh moved = start;
    Roughen(moved, sigma, 9);
    const MotionGuard guard(start, {}, {});
    Repaired one, two;
    {
      const ThreadLimit limit(1);
      one = Repair(start, moved.vertices, &guard);
    }
    {
      const ThreadLimit limit(2);
      two = Repair(start, moved.vertices, &guard);
    }
    EXPECT_EQ(one.mesh.vertices, two.mesh.vertices);
    EXPECT_TRUE(one.result.left.empty());
    EXPECT_TRUE(PairsByCgal(one.mesh).empty()) << sigma;
  }
}

TEST(SurfaceRepair, DistantPartsAreIndependent) {
  const TriangleMesh part = Sheets(20, 3, 0.1);
  TriangleMesh far = part;
  for (Vector3d& v : far.vertices) v.x() += 300;
  TriangleMesh moved = part, moved_far = far;
  Roughen(moved, 0.06, 1);
  Roughen(moved_far, 0.2, 2);
  const Repaired alone = Repair(part, moved.vertices, nullptr);
  const Repaired together = Repair(Joined(part, far), Joined(moved, moved_far).vertices, nullptr);
  ASSERT_GT(alone.result.changed_vertices, 0);
  for (size_t v = 0; v < part.vertices.size(); ++v) ASSERT_EQ(alone.mesh.vertices[v], together.mesh.vertices[v]);
}

}  // namespace
}  // namespace tessera
