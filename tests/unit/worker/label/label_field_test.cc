#include "worker/label/label_field.h"

#include <gtest/gtest.h>

#include <cmath>

#include "worker/label/belief_propagation.h"

namespace tessera {
namespace {

constexpr double kDegree = 3.141592653589793 / 180;

std::vector<SceneClass> MakeClasses() {
  std::vector<SceneClass> classes(3);
  classes[0] = {"ground", {}, 30 * kDegree, 0, 1};
  classes[1] = {"facade", {}, 30 * kDegree, 90 * kDegree, 1};
  classes[2].name = "vegetation";
  return classes;
}

// A grid of n x n quads, each two triangles, on `size` metres in the plane spanned by x and `second`.
TriangleMesh MakeGrid(int n, double size, const Eigen::Vector3d& second) {
  TriangleMesh mesh;
  for (int y = 0; y <= n; ++y) {
    for (int x = 0; x <= n; ++x) mesh.vertices.push_back(size / n * (x * Eigen::Vector3d::UnitX() + y * second));
  }
  const auto at = [n](int x, int y) { return static_cast<uint32_t>(y * (n + 1) + x); };
  for (int y = 0; y < n; ++y) {
    for (int x = 0; x < n; ++x) {
      mesh.faces.push_back({at(x, y), at(x + 1, y), at(x + 1, y + 1)});
      mesh.faces.push_back({at(x, y), at(x + 1, y + 1), at(x, y + 1)});
    }
  }
  return mesh;
}

std::vector<MeshEdge> EdgesOf(const TriangleMesh& mesh) { return EdgeList(*BuildTopology(mesh)); }

LabelField FieldOf(const TriangleMesh& mesh, const FaceLikelihoods& likelihoods, const LabelOptions& options = {}) {
  return BuildLabelField(mesh, EdgesOf(mesh), likelihoods, MakeClasses(), Eigen::Vector3d::UnitZ(), 0.1, options);
}

TEST(LabelField, PriorPenalisesTheClassesWhoseNormalsDiffer) {
  for (const bool wall : {false, true}) {
    const TriangleMesh mesh = MakeGrid(1, 1, wall ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitY());
    const LabelField field = FieldOf(mesh, FaceLikelihoods(2, 3));
    EXPECT_EQ(field.unary[0] > 0, wall) << "ground";
    EXPECT_EQ(field.unary[1] > 0, !wall) << "facade";
    EXPECT_EQ(field.unary[2], 0) << "vegetation";
  }
}

TEST(LabelField, EnergyDoesNotDependOnHowFinelyTheMeshIsSplit) {
  double energies[2];
  for (const int fine : {0, 1}) {
    const int n = fine ? 8 : 2;
    const TriangleMesh mesh = MakeGrid(n, 2, Eigen::Vector3d::UnitY());
    FaceLikelihoods sums(mesh.faces.size(), 3);
    std::vector<int32_t> labels;
    for (size_t f = 0; f < mesh.faces.size(); ++f) {
      const bool left = (mesh.Corner(f, 0) + mesh.Corner(f, 1) + mesh.Corner(f, 2)).x() / 3 < 1;
      sums.pixels[f] = 1e5f;
      sums.sum[3 * f] = left ? 7e4f : 2e4f;
      sums.sum[3 * f + 1] = left ? 1e4f : 3e4f;
      sums.sum[3 * f + 2] = left ? 2e4f : 5e4f;
      labels.push_back(left ? 1 : 2);
    }
    energies[fine] = LabelEnergy(FieldOf(mesh, sums), labels);
  }
  EXPECT_NEAR(energies[1], energies[0], 1e-4 * energies[0]);
}

TEST(LabelField, FewPixelsWeighLess) {
  const TriangleMesh mesh = MakeGrid(1, 1, Eigen::Vector3d::UnitY());
  FaceLikelihoods sums(2, 3);
  const float pixels[] = {1, 100};
  for (int f = 0; f < 2; ++f) {
    sums.pixels[f] = pixels[f];
    sums.sum[3 * f] = 0.9f * pixels[f];
    sums.sum[3 * f + 2] = 0.1f * pixels[f];
  }
  const LabelField field = FieldOf(mesh, sums);
  EXPECT_LT(field.unary[2] - field.unary[0], field.unary[5] - field.unary[3]);
}

TEST(LabelField, ClassThatIsNeverSeenStaysFinite) {
  const TriangleMesh mesh = MakeGrid(1, 1, Eigen::Vector3d::UnitY());
  FaceLikelihoods sums(2, 3);
  sums.pixels = {1e6f, 1e6f};
  sums.sum[0] = sums.sum[3] = 1e6f;
  const LabelField field = FieldOf(mesh, sums);
  for (const float u : field.unary) EXPECT_TRUE(std::isfinite(u));
  EXPECT_EQ(SolveLabels(field, {2, 2}, {}).labels, (std::vector<int32_t>{0, 0}));
}

TEST(LabelField, PaperFormCountsSquareMetresAndPlainSums) {
  const TriangleMesh mesh = MakeGrid(1, 2, Eigen::Vector3d::UnitY());  // two faces of 2 m²
  FaceLikelihoods sums(2, 3);
  sums.pixels = {10, 10};
  sums.sum = {5, 3, 2, 5, 3, 2};
  LabelOptions options;
  options.form = LabelOptions::Form::kPaper;
  const LabelField field = FieldOf(mesh, sums, options);
  EXPECT_NEAR(field.unary[0], -std::log(5.0), 1e-6);
  EXPECT_NEAR(field.unary[1], -std::log(3.0) + 0.35 * 2, 1e-6);
  ASSERT_EQ(field.edges.size(), 1u);
  EXPECT_NEAR(field.edges[0].weight, 0.5 * (2 + 2), 1e-6);
}

TEST(Unary, EveryPixelCountsForItsFaceAtAnyResolution) {
  FaceMap map;
  map.width = 4;
  map.height = 2;
  map.face = {0, 0, 1, -1, 0, 0, 1, 1};
  // Class 1 has 0.25 left and 0.75 right; the same picture at half the resolution.
  FloatImage fine(4, 2, 2, 0.0f), coarse(2, 1, 2, 0.0f);
  for (int y = 0; y < 2; ++y) {
    for (int x = 0; x < 4; ++x) {
      fine.at(x, y, 1) = x < 2 ? 0.25f : 0.75f;
      fine.at(x, y, 0) = 1 - fine.at(x, y, 1);
    }
  }
  coarse.data = {0.75f, 0.25f, 0.25f, 0.75f};
  FaceLikelihoods sums(2, 2), half(2, 2);
  AddLikelihoods(map, fine, {}, &sums);
  EXPECT_EQ(sums.pixels, (std::vector<float>{4, 3}));
  EXPECT_EQ(sums.sum, (std::vector<float>{3, 1, 0.75f, 2.25f}));
  AddLikelihoods(map, coarse, {0.5, 0.5, 0, 0}, &half);
  EXPECT_EQ(half.pixels, sums.pixels);
  // Bilinear between the two coarse pixels, whose centres are at 1 and 3 of the fine ones.
  EXPECT_NEAR(half.sum[1], 2 * 0.25 + 2 * 0.375, 1e-6);
  EXPECT_NEAR(half.sum[3], 2 * 0.625 + 0.75, 1e-6);
}

}  // namespace
}  // namespace tessera
