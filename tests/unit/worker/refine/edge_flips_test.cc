#include "worker/refine/edge_flips.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "common/base/parallel.h"
#include "common/geometry/mesh_defects.h"
#include "tests/support/relief_scene.h"
#include "tests/unit/worker/refine/random_reliefs.h"
#include "worker/refine/self_intersection.h"

namespace tessera {
namespace {

constexpr int kCells = 8;

// Cells of one metre with all diagonals from (x, y) to (x + 1, y + 1). A slope begins at x + y = 0, so the diagonals
// of the cells on that line cross the crease.
TriangleMesh SlopeAcrossTheEdges() {
  return HeightField(kCells, kCells / 2, [](double x, double y) { return 0.8 * std::max(0.0, x + y); });
}

std::vector<uint64_t> OneGroup(const TriangleMesh& mesh) { return std::vector<uint64_t>(mesh.faces.size(), 7); }

// The cost Σ |e| |n_f - n_g| over edges between faces of one group, computed independently of the tested code.
double CreaseCost(const TriangleMesh& mesh, const std::vector<uint64_t>& groups) {
  std::map<std::pair<uint32_t, uint32_t>, std::vector<uint32_t>> edges;
  for (uint32_t f = 0; f < mesh.faces.size(); ++f) {
    for (int k = 0; k < 3; ++k) edges[std::minmax(mesh.faces[f][k], mesh.faces[f][(k + 1) % 3])].push_back(f);
  }
  double cost = 0;
  for (const auto& [edge, faces] : edges) {
    if (faces.size() != 2 || groups[faces[0]] != groups[faces[1]]) continue;
    const double bend = (FaceNormal(mesh, faces[0]) - FaceNormal(mesh, faces[1])).norm();
    cost += (mesh.vertices[edge.first] - mesh.vertices[edge.second]).norm() * bend;
  }
  return cost;
}

// Smallest angle of any face, radians.
double LeastAngle(const TriangleMesh& mesh) {
  double least = 10;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const Vector3d to_next = mesh.Corner(f, (k + 1) % 3) - mesh.Corner(f, k);
      const Vector3d to_last = mesh.Corner(f, (k + 2) % 3) - mesh.Corner(f, k);
      least = std::min(least, std::atan2(to_next.cross(to_last).norm(), to_next.dot(to_last)));
    }
  }
  return least;
}

// Number of faces that point down.
int64_t FacesDown(const TriangleMesh& mesh) {
  int64_t count = 0;
  for (size_t f = 0; f < mesh.faces.size(); ++f) count += FaceCross(mesh, f).z() < 0;
  return count;
}

std::vector<uint64_t> GroupsOf(const TriangleMesh& mesh, double side) {
  std::vector<uint64_t> groups;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Vector3d at = MeshSpans(mesh).Centroid(f) / side;
    groups.push_back(static_cast<uint64_t>(std::floor(at.x()) + 1000 * std::floor(at.y() + 10)));
  }
  return groups;
}

TEST(FlipEdges, AlignsEdgesWithTheCrease) {
  TriangleMesh mesh = SlopeAcrossTheEdges();
  const std::vector<Eigen::Vector3d> vertices = mesh.vertices;
  const std::vector<uint32_t> changed = FlipEdges(OneGroup(mesh), &mesh);
  EXPECT_EQ(mesh.vertices, vertices);
  EXPECT_EQ(changed.size(), 2u * kCells);
  for (const uint32_t f : changed) {
    const auto side = [&](uint32_t v) { return mesh.vertices[v].x() + mesh.vertices[v].y(); };
    const Triangle& t = mesh.faces[f];
    const double low = std::min({side(t[0]), side(t[1]), side(t[2])});
    const double high = std::max({side(t[0]), side(t[1]), side(t[2])});
    EXPECT_TRUE(low >= 0 || high <= 0) << f;
  }
}

TEST(FlipEdges, KeepsBordersOfClassesAndGroups) {
  TriangleMesh mesh = SlopeAcrossTheEdges();
  for (size_t f = 0; f < mesh.faces.size(); ++f) mesh.labels.push_back(static_cast<int32_t>(f % 2));
  EXPECT_TRUE(FlipEdges(OneGroup(mesh), &mesh).empty());
  mesh.labels.assign(mesh.faces.size(), 3);
  std::vector<uint64_t> groups;
  for (size_t f = 0; f < mesh.faces.size(); ++f) groups.push_back(f % 2);
  EXPECT_TRUE(FlipEdges(groups, &mesh).empty());
  EXPECT_FALSE(FlipEdges(OneGroup(mesh), &mesh).empty());
}

// A flat tetrahedron: flipping the upper group's only edge would gain, but the new edge already exists in the lower
// group.
TEST(FlipEdges, DoesNotDuplicateAnEdgeOfAnotherGroup) {
  TriangleMesh mesh;
  mesh.vertices = {{-1.5, 0, 0.4}, {1.5, 0, 0.4}, {0, 1, 0}, {0, -1, 0}};
  mesh.faces = {{0, 1, 2}, {1, 0, 3}, {0, 2, 3}, {2, 1, 3}};
  ASSERT_TRUE(CheckMesh(mesh)->IsClean());
  EXPECT_TRUE(FlipEdges({1, 1, 2, 2}, &mesh).empty());
}

// A needle intersects one of the new edges.
TEST(FlipEdges, CausesNoNewIntersections) {
  TriangleMesh mesh = SlopeAcrossTheEdges();
  const TriangleMesh start = mesh;
  const auto first = static_cast<uint32_t>(mesh.vertices.size());
  // In cell (3, 4) the old edge is .4 m above the middle, and the new one would be at 0.
  mesh.vertices.insert(mesh.vertices.end(), {{-0.51, 0.5, -0.05}, {-0.49, 0.5, -0.05}, {-0.5, 0.5, 0.2}});
  mesh.faces.push_back({first, first + 1, first + 2});
  const std::vector<FacePair> before = IntersectingFacePairs(mesh);
  const std::vector<uint32_t> changed = FlipEdges(OneGroup(mesh), &mesh);
  EXPECT_TRUE(NewPairs(before, IntersectingFacePairs(mesh)).empty());
  EXPECT_EQ(changed.size(), 2u * (kCells - 1));
  for (const uint32_t f : {2 * (4 * kCells + 3), 2 * (4 * kCells + 3) + 1}) EXPECT_EQ(mesh.faces[f], start.faces[f]);
}

// Random meshes: rough, with holes and folds.
TEST(FlipEdges, InvariantsHoldOnRandomMeshes) {
  int64_t flips = 0, down_before = 0, down = 0;
  for (uint64_t seed = 1; seed <= 60; ++seed) {
    Random random(seed);
    const TriangleMesh start = RandomRelief(random, 40);
    const std::vector<uint64_t> groups = GroupsOf(start, random.Uniform(3, 20));
    TriangleMesh mesh = start;
    const std::vector<uint32_t> changed = FlipEdges(groups, &mesh);
    flips += static_cast<int64_t>(changed.size());
    EXPECT_EQ(mesh.vertices, start.vertices);
    EXPECT_EQ(mesh.labels, start.labels);
    if (!changed.empty()) {
      EXPECT_LT(CreaseCost(mesh, groups), CreaseCost(start, groups)) << seed;
    }
    for (uint32_t f = 0; f < mesh.faces.size(); ++f) {
      EXPECT_EQ(mesh.faces[f] != start.faces[f], std::binary_search(changed.begin(), changed.end(), f));
    }
    EXPECT_GE(LeastAngle(mesh), std::min(LeastAngle(start), 0.17)) << seed;
    down_before += FacesDown(start);
    down += FacesDown(mesh);
    const MeshDefects defects = *CheckMesh(mesh), defects_before = *CheckMesh(start);
    EXPECT_EQ(defects.non_manifold_edges.count, defects_before.non_manifold_edges.count) << seed;
    EXPECT_EQ(defects.conflicting_edges.count, 0) << seed;
    EXPECT_EQ(defects.non_manifold_vertices.count, defects_before.non_manifold_vertices.count) << seed;
    EXPECT_EQ(defects.boundary_edges, defects_before.boundary_edges) << seed;
    EXPECT_EQ(defects.unreferenced_vertices.count, defects_before.unreferenced_vertices.count) << seed;
    // Only within one group: pairs across groups are not tested.
    for (const auto& [f, g] : NewPairs(IntersectingFacePairs(start), IntersectingFacePairs(mesh))) {
      EXPECT_NE(groups[f], groups[g]) << seed;
    }
    const ThreadLimit limit(1);
    TriangleMesh alone = start;
    FlipEdges(groups, &alone);
    EXPECT_EQ(alone.faces, mesh.faces) << seed;
  }
  EXPECT_GT(flips, 1000);
  EXPECT_LT(down, down_before) << "folds are smoothed, and none is made";
}

// Required by tiling: a submesh with whole groups gives their faces the same result as the whole mesh, wherever all
// other vertices are, and for any numbering that keeps the order.
TEST(FlipEdges, GroupsAreIndependent) {
  int64_t compared = 0;
  for (uint64_t seed = 1; seed <= 40; ++seed) {
    Random random(seed);
    const TriangleMesh start = RandomRelief(random, 40);
    const std::vector<uint64_t> groups = GroupsOf(start, random.Uniform(3, 9));
    TriangleMesh whole = start;
    FlipEdges(groups, &whole);
    const uint64_t kept = groups[random.Below(static_cast<int64_t>(groups.size()))];
    // The part: the group and faces of other groups, whose other vertices are all moved.
    std::vector<uint8_t> of_kept(start.vertices.size());
    for (size_t f = 0; f < groups.size(); ++f) {
      if (groups[f] != kept) continue;
      for (const uint32_t v : start.faces[f]) of_kept[v] = 1;
    }
    TriangleMesh part;
    std::vector<uint32_t> place(start.vertices.size());
    for (size_t v = 0; v < place.size(); ++v) {
      place[v] = static_cast<uint32_t>(part.vertices.size());
      if (!of_kept[v] && Chance(random, 0.3)) part.vertices.emplace_back(0, 0, 0);  // in no face
      place[v] = static_cast<uint32_t>(part.vertices.size());
      part.vertices.push_back(of_kept[v] ? start.vertices[v] : start.vertices[v] + RandomVector(random));
    }
    std::vector<uint64_t> groups_of_part;
    std::vector<size_t> faces;
    for (size_t f = 0; f < groups.size(); ++f) {
      if (groups[f] != kept && Chance(random, 0.5)) continue;
      const Triangle& t = start.faces[f];
      part.faces.push_back({place[t[0]], place[t[1]], place[t[2]]});
      part.labels.push_back(start.labels[f]);
      groups_of_part.push_back(groups[f]);
      faces.push_back(f);
    }
    FlipEdges(groups_of_part, &part);
    for (size_t i = 0; i < faces.size(); ++i) {
      if (groups_of_part[i] != kept) continue;
      const Triangle& t = whole.faces[faces[i]];
      EXPECT_EQ(part.faces[i], (Triangle{place[t[0]], place[t[1]], place[t[2]]})) << seed;
      compared += t != start.faces[faces[i]];
    }
  }
  EXPECT_GT(compared, 100);
}

}  // namespace
}  // namespace tessera
