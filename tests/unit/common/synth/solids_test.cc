#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <map>
#include <set>

#include "common/synth/city/surface.h"
#include "common/synth/city/terrain_grid.h"
#include "common/synth/start_mesh/marching_cubes.h"
#include "common/synth/start_mesh/start_mesh.h"

namespace tessera {
namespace {

// Directed edges without an opposite edge.
int64_t OpenEdges(const TriangleMesh& mesh) {
  std::map<std::pair<uint32_t, uint32_t>, int> directed;
  for (const Triangle& t : mesh.faces) {
    for (int k = 0; k < 3; ++k) ++directed[{t[k], t[(k + 1) % 3]}];
  }
  int64_t open = 0;
  for (const auto& [edge, count] : directed) {
    const auto partner = directed.find({edge.second, edge.first});
    open += std::abs(count - (partner == directed.end() ? 0 : partner->second));
  }
  return open;
}

double Volume(const TriangleMesh& mesh) {
  double volume = 0;
  for (const Triangle& t : mesh.faces) {
    volume += mesh.vertices[t[0]].dot(mesh.vertices[t[1]].cross(mesh.vertices[t[2]])) / 6;
  }
  return volume;
}

// The connected components of the mesh.
std::vector<TriangleMesh> Parts(const TriangleMesh& mesh) {
  std::vector<uint32_t> parent(mesh.vertices.size());
  for (uint32_t v = 0; v < parent.size(); ++v) parent[v] = v;
  const auto root = [&](uint32_t v) {
    while (parent[v] != v) v = parent[v] = parent[parent[v]];
    return v;
  };
  for (const Triangle& t : mesh.faces) {
    parent[root(t[1])] = root(t[0]);
    parent[root(t[2])] = root(t[0]);
  }
  std::map<uint32_t, TriangleMesh> parts;
  for (const Triangle& t : mesh.faces) {
    TriangleMesh& part = parts[root(t[0])];
    part.vertices = mesh.vertices;
    part.faces.push_back(t);
  }
  std::vector<TriangleMesh> list;
  for (auto& [key, part] : parts) list.push_back(std::move(part));
  return list;
}

TEST(BuildBuildingTest, SolidsAreClosedAndOrientedOutwards) {
  for (const RoofKind roof : {RoofKind::kFlat, RoofKind::kGabled, RoofKind::kHipped}) {
    for (const double depth : {7.0, 12.0}) {
      BuildingSpec spec;
      spec.centre = {0, 0};
      spec.yaw_rad = 0.3;
      spec.width_m = 10;
      spec.depth_m = depth;
      spec.foot_z_m = -1;
      spec.roof = roof;
      spec.balconies = spec.pilasters = true;
      spec.dormers = 2;
      spec.chimneys = 1;
      spec.seed = 5;
      BlockSolids block;
      BuildBuilding(spec, block);
      const TriangleMesh& mesh = block.surface.mesh;
      EXPECT_EQ(OpenEdges(mesh), 0);
      for (const TriangleMesh& part : Parts(mesh)) EXPECT_GT(Volume(part), 0.01);
      ASSERT_EQ(mesh.labels.size(), mesh.faces.size());
      ASSERT_EQ(block.surface.patch_of_face.size(), mesh.faces.size());
      for (size_t f = 0; f < mesh.faces.size(); ++f) {
        EXPECT_GT(FaceArea(mesh, f), 1e-5);
        EXPECT_LT(block.surface.patch_of_face[f], block.surface.patches.size());
      }
    }
  }
}

TEST(BuildTreeTest, CrownIsClosedAndOrientedOutwards) {
  BlockSolids block;
  BuildTree({{3, 4, 5}, {2, 2, 3}, 3.5, 7}, block);
  EXPECT_EQ(OpenEdges(block.surface.mesh), 0);
  for (const TriangleMesh& part : Parts(block.surface.mesh)) EXPECT_GT(Volume(part), 0.01);
}

TEST(ConvexSolidTest, AgreesWithTheVisibleSurface) {
  // Corners of all solids of a block lie on the boundary of their own half-spaces, never outside.
  const CityPlan plan{2, 2, 4, 0.12};
  const BlockSolids block = BuildBlock(plan, 0, 1);
  ASSERT_FALSE(block.solids.empty());
  for (const ConvexSolid& solid : block.solids) EXPECT_LT(solid.Distance(solid.box.center()), 0.0);
}

TEST(GroundTest, AdjacentBlocksMatchAndHaveKerbs) {
  const CityPlan plan{2, 1, 9, 0.12};
  const GroundGrid grid = MakeGroundGrid(plan);
  const TexturedSurface left = BuildGround(plan, grid, 0, 0), right = BuildGround(plan, grid, 1, 0);
  std::set<std::array<double, 3>> of_left;
  for (const auto& p : left.mesh.vertices) of_left.insert({p.x(), p.y(), p.z()});
  size_t shared = 0;
  for (const auto& p : right.mesh.vertices) shared += of_left.count({p.x(), p.y(), p.z()});
  EXPECT_EQ(shared, grid.y_lines.size());
  const double kerb = plan.MinX() + CityPlan::kHalfStreet;
  EXPECT_NEAR(GroundHeight(plan, kerb + 0.001, 0) - GroundHeight(plan, kerb - 0.001, 0), CityPlan::kKerbHeight, 0.01);
}

TEST(CubeLoopTableTest, LoopsCoverEveryCrossingEdgeOnce) {
  const auto& edges = CubeEdgeTable();
  for (int inside = 0; inside < 256; ++inside) {
    std::array<int, kCubeEdges> used{};
    for (const CubeLoop& loop : CubeLoopTable()[inside]) {
      EXPECT_GE(loop.edges.size(), 3u);
      for (int e : loop.edges) ++used[e];
    }
    for (int e = 0; e < kCubeEdges; ++e) {
      const int a = edges[e].corner, b = a | (1 << edges[e].axis);
      EXPECT_EQ(used[e], (inside >> a & 1) != (inside >> b & 1) ? 1 : 0) << inside;
    }
  }
}

class FreshBlocks : public BlockSource {
 public:
  explicit FreshBlocks(const CityPlan& plan) {
    for (int row = 0; row < plan.rows; ++row) {
      for (int column = 0; column < plan.columns; ++column) blocks_[{column, row}] = BuildBlock(plan, column, row);
    }
  }
  const BlockSolids& Solids(int column, int row) const override { return blocks_.at({column, row}); }

 private:
  std::map<std::pair<int, int>, BlockSolids> blocks_;
};

TEST(ExtractStartChunkTest, AdjacentChunksHaveEqualBorderVertices) {
  const CityPlan plan{2, 1, 3, 0.3};
  const FreshBlocks blocks(plan);
  const StartChunk left = ExtractStartChunk(plan, blocks, 0, 0), right = ExtractStartChunk(plan, blocks, 1, 0);
  std::map<uint64_t, Eigen::Vector3d> of_left;
  for (size_t v = 0; v < left.vertices.size(); ++v) {
    if (left.keys[v] != StartChunk::kNoKey) of_left[left.keys[v]] = left.vertices[v];
  }
  int shared = 0;
  for (size_t v = 0; v < right.vertices.size(); ++v) {
    const auto place = of_left.find(right.keys[v]);
    if (place == of_left.end()) continue;
    ++shared;
    EXPECT_TRUE(right.on_border[v]);
    EXPECT_EQ(place->second, right.vertices[v]);
  }
  EXPECT_GT(shared, 30);
}

}  // namespace
}  // namespace tessera
