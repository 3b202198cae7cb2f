#include "worker/refine/density.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "tests/support/relief_scene.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

double LargestFootprint(const TriangleMesh& mesh, const std::vector<PosedCamera>& cameras) {
  double largest = 0;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    for (const PosedCamera& camera : cameras) {
      Eigen::Vector2d p[3];
      bool seen = true;
      for (int k = 0; k < 3; ++k) {
        const Vector3d q = camera.Project(mesh.Corner(f, k));
        seen = seen && camera.InImage(q);
        p[k] = q.head<2>();
      }
      const Eigen::Vector2d a = p[1] - p[0], b = p[2] - p[0];
      if (seen) largest = std::max(largest, 0.5 * std::abs(a.x() * b.y() - a.y() * b.x()));
    }
  }
  return largest;
}

double Area(const TriangleMesh& mesh) {
  double area = 0;
  for (size_t f = 0; f < mesh.faces.size(); ++f) area += FaceArea(mesh, f);
  return area;
}

TriangleMesh Relief() {
  TriangleMesh mesh = HeightField(7, 4.5, ReliefHeight);
  for (size_t f = 0; f < mesh.faces.size(); ++f) mesh.labels.push_back(static_cast<int32_t>(f % 3));
  return mesh;
}

TEST(Density, FootprintsFallBelowTheLimitWithoutChangingTheSurface) {
  const TriangleMesh mesh = Relief();
  const std::vector<PosedCamera> cameras = ReliefCameras(240);
  const SplitMesh split = SplitLargeFaces(mesh, cameras, {16, 8});
  EXPECT_GT(LargestFootprint(mesh, cameras), 100);
  EXPECT_LE(LargestFootprint(split.mesh, cameras), 16.0001);
  EXPECT_NEAR(Area(split.mesh), Area(mesh), 1e-9);
  ASSERT_EQ(split.parent_face.size(), split.mesh.faces.size());
  ASSERT_EQ(split.mesh.labels.size(), split.mesh.faces.size());
  for (size_t v = 0; v < mesh.vertices.size(); ++v) EXPECT_EQ(split.mesh.vertices[v], mesh.vertices[v]);
  std::vector<double> area(mesh.faces.size());
  for (size_t f = 0; f < split.parent_face.size(); ++f) {
    const uint32_t parent = split.parent_face[f];
    EXPECT_EQ(split.mesh.labels[f], mesh.labels[parent]);
    EXPECT_GT(FaceNormal(split.mesh, f).dot(FaceNormal(mesh, parent)), 0.999999);
    area[parent] += FaceArea(split.mesh, f);
  }
  for (size_t f = 0; f < area.size(); ++f) EXPECT_NEAR(area[f], FaceArea(mesh, f), 1e-12);
}

TEST(Density, IsConforming) {
  const SplitMesh split = SplitLargeFaces(Relief(), ReliefCameras(200), {16, 8});
  std::map<std::pair<uint32_t, uint32_t>, int> uses;
  std::set<std::array<double, 3>> places;
  for (const Vector3d& v : split.mesh.vertices) places.insert({v.x(), v.y(), v.z()});
  EXPECT_EQ(places.size(), split.mesh.vertices.size());
  for (const Triangle& face : split.mesh.faces) {
    for (int k = 0; k < 3; ++k) ++uses[{face[k], face[(k + 1) % 3]}];
  }
  for (const auto& [edge, count] : uses) {
    EXPECT_EQ(count, 1);
    if (uses.count({edge.second, edge.first}) > 0) continue;
    // Edges with one face lie on the square's border, so there are no T-junctions inside.
    const Vector3d &a = split.mesh.vertices[edge.first], &b = split.mesh.vertices[edge.second];
    const auto border = [](const Vector3d& p) { return std::max(std::abs(p.x()), std::abs(p.y())) > 4.5 - 1e-9; };
    EXPECT_TRUE(border(a) && border(b));
  }
}

TEST(Density, SubmeshIsSplitLikeTheWholeMesh) {
  const TriangleMesh mesh = Relief();
  const std::vector<PosedCamera> cameras = ReliefCameras(200);
  TriangleMesh part = mesh;
  part.faces.assign(mesh.faces.begin(), mesh.faces.begin() + 50);
  part.labels.assign(mesh.labels.begin(), mesh.labels.begin() + 50);
  const SplitMesh whole = SplitLargeFaces(mesh, cameras, {16, 8});
  const SplitMesh piece = SplitLargeFaces(part, cameras, {16, 8});
  size_t at = 0;
  for (size_t f = 0; f < whole.parent_face.size(); ++f) {
    if (whole.parent_face[f] >= 50) continue;
    ASSERT_LT(at, piece.mesh.faces.size());
    EXPECT_EQ(piece.parent_face[at], whole.parent_face[f]);
    for (int k = 0; k < 3; ++k) EXPECT_EQ(piece.mesh.Corner(at, k), whole.mesh.Corner(f, k));
    ++at;
  }
  EXPECT_EQ(at, piece.mesh.faces.size());
}

TEST(Density, InvisibleFacesAreNotSplit) {
  const TriangleMesh mesh = Relief();
  EXPECT_EQ(SplitLargeFaces(mesh, {}, {16, 8}).mesh.faces, mesh.faces);
}

}  // namespace
}  // namespace tessera
