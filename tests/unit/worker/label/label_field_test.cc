#include "worker/label/label_field.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/support/label_energy.h"
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

std::vector<MeshEdge> EdgesOf(const TriangleMesh& mesh) { return EdgeList(mesh.faces); }

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

TEST(LabelField, EnergyIsIndependentOfSubdivision) {
  double energies[2];
  for (const int fine : {0, 1}) {
    const int n = fine ? 8 : 2;
    const TriangleMesh mesh = MakeGrid(n, 2, Eigen::Vector3d::UnitY());
    FaceLikelihoods sums(mesh.faces.size(), 3);
    std::vector<int32_t> labels;
    for (size_t f = 0; f < mesh.faces.size(); ++f) {
      const bool left = (mesh.Corner(f, 0) + mesh.Corner(f, 1) + mesh.Corner(f, 2)).x() / 3 < 1;
      const float pixels = 400.0f / static_cast<float>(mesh.faces.size());
      sums.pixels[f] = pixels;
      sums.sum[3 * f] = pixels * (left ? 0.7f : 0.2f);
      sums.sum[3 * f + 1] = pixels * (left ? 0.1f : 0.3f);
      sums.sum[3 * f + 2] = pixels * (left ? 0.2f : 0.5f);
      labels.push_back(left ? 1 : 2);
    }
    energies[fine] = LabelEnergy(FieldOf(mesh, sums), labels);
  }
  EXPECT_NEAR(energies[1], energies[0], 1e-4 * energies[0]);
}

TEST(LabelField, AbsentClassDoesNotChangeTheOthers) {
  const TriangleMesh mesh = MakeGrid(2, 1, Eigen::Vector3d::UnitY());
  std::vector<SceneClass> more = MakeClasses();
  more.push_back({"water", {}, 10 * kDegree, 0, 1});
  FaceLikelihoods three(mesh.faces.size(), 3), four(mesh.faces.size(), 4);
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    three.pixels[f] = four.pixels[f] = 3.0f * f;
    for (int l = 0; l < 3; ++l) three.sum[3 * f + l] = four.sum[4 * f + l] = 0.5f * f * (l + 1);
  }
  const LabelField field = FieldOf(mesh, three);
  const LabelField same =
      BuildLabelField(mesh, EdgesOf(mesh), four, more, Eigen::Vector3d::UnitZ(), 0.1, LabelOptions());
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    for (int l = 0; l < 3; ++l) EXPECT_EQ(same.unary[4 * f + l], field.unary[3 * f + l]);
  }
}

// The same likelihoods on a subdivided mesh give the same labels, even with few pixels per face.
TEST(LabelField, LabelsAreIndependentOfSubdivision) {
  std::vector<int32_t> coarse;
  for (const int n : {12, 24}) {
    const TriangleMesh mesh = MakeGrid(n, 4, Eigen::Vector3d::UnitY());
    const float pixels = 7.0f * 288 / static_cast<float>(mesh.faces.size());
    FaceLikelihoods sums(mesh.faces.size(), 3);
    for (size_t f = 0; f < mesh.faces.size(); ++f) {
      // A disc of class 2 on class 0, with uncertain likelihoods.
      const Eigen::Vector3d p = (mesh.Corner(f, 0) + mesh.Corner(f, 1) + mesh.Corner(f, 2)) / 3;
      const bool disc = (p - Eigen::Vector3d(2, 2, 0)).norm() < 1.1;
      sums.pixels[f] = pixels;
      for (int l = 0; l < 3; ++l) sums.sum[3 * f + l] = pixels * (l == (disc ? 2 : 0) ? 0.5f : 0.25f);
    }
    const LabelField field = FieldOf(mesh, sums);
    const std::vector<int32_t> labels = SolveLabels(field, std::vector<int32_t>(mesh.faces.size(), -1), {}).labels;
    if (coarse.empty()) {
      coarse = labels;
      continue;
    }
    // Share of the area with equal labels, at the centres of the fine faces.
    int same = 0;
    for (size_t f = 0; f < mesh.faces.size(); ++f) {
      const Eigen::Vector3d p = 12 / 4.0 * (mesh.Corner(f, 0) + mesh.Corner(f, 1) + mesh.Corner(f, 2)) / 3;
      const int x = static_cast<int>(p.x()), y = static_cast<int>(p.y());
      const bool upper = p.y() - y > p.x() - x;
      same += coarse[2 * (12 * y + x) + upper] == labels[f];
    }
    EXPECT_GT(same, 0.97 * mesh.faces.size());  // the disc's own stairs differ
    EXPECT_GT(std::count(labels.begin(), labels.end(), 2), 0);
  }
}

// Five images of a roof; one of them is certain of a wrong class.
TEST(LabelField, OneOutlierViewDoesNotDecideALabel) {
  const TriangleMesh mesh = MakeGrid(1, 1, Eigen::Vector3d::UnitY());
  FaceLikelihoods sums(2, 3);
  for (int f = 0; f < 2; ++f) {
    sums.pixels[f] = 50;
    sums.sum[3 * f] = 40 * 0.5f;
    sums.sum[3 * f + 1] = 40 * 0.3f;
    sums.sum[3 * f + 2] = 40 * 0.2f + 10;
  }
  EXPECT_EQ(SolveLabels(FieldOf(mesh, sums), {-1, -1}, {}).labels, (std::vector<int32_t>{0, 0}));
}

// A tile's field is the restriction of the city's field to the tile's faces.
TEST(LabelField, SubmeshGivesTheSubfield) {
  const int n = 6, skipped = 2;
  TriangleMesh mesh = MakeGrid(n, 1.7, Eigen::Vector3d(0.1, 0.9, 0.3));
  for (size_t v = 0; v < mesh.vertices.size(); ++v) mesh.vertices[v].z() += 0.01 * ((v * v) % 17);
  FaceLikelihoods sums(mesh.faces.size(), 3), part_sums(mesh.faces.size() - 2 * n * skipped, 3);
  TriangleMesh part;  // without the first rows
  const uint32_t vertex = skipped * (n + 1);
  const size_t face = 2 * n * skipped;
  part.vertices.assign(mesh.vertices.begin() + vertex, mesh.vertices.end());
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    sums.pixels[f] = static_cast<float>(f % 5);
    for (int l = 0; l < 3; ++l) sums.sum[3 * f + l] = 0.3f * static_cast<float>((f * (l + 2)) % 7);
    if (f < face) continue;
    part.faces.push_back(mesh.faces[f]);
    for (uint32_t& v : part.faces.back()) v -= vertex;
    part_sums.pixels[f - face] = sums.pixels[f];
    std::copy_n(&sums.sum[3 * f], 3, &part_sums.sum[3 * (f - face)]);
  }
  for (const LabelOptions::Form form : {LabelOptions::Form::kTessera, LabelOptions::Form::kPaper}) {
    LabelOptions options;
    options.form = form;
    const LabelField whole = FieldOf(mesh, sums, options), some = FieldOf(part, part_sums, options);
    EXPECT_TRUE(std::equal(some.unary.begin(), some.unary.end(), whole.unary.begin() + 3 * face, whole.unary.end()));
    std::vector<FieldEdge> expected;
    for (const FieldEdge& e : whole.edges) {
      if (e.face0 < face || e.face1 < face) continue;
      expected.push_back({static_cast<uint32_t>(e.face0 - face), static_cast<uint32_t>(e.face1 - face), e.weight});
    }
    ASSERT_EQ(some.edges.size(), expected.size());
    for (size_t e = 0; e < expected.size(); ++e) {
      EXPECT_EQ(some.edges[e].face0, expected[e].face0);
      EXPECT_EQ(some.edges[e].face1, expected[e].face1);
      EXPECT_EQ(some.edges[e].weight, expected[e].weight);
    }
  }
}

TEST(LabelField, FewerPixelsWeighLess) {
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

TEST(LabelField, UnaryOfAnUnobservedClassIsFinite) {
  const TriangleMesh mesh = MakeGrid(1, 1, Eigen::Vector3d::UnitY());
  FaceLikelihoods sums(2, 3);
  sums.pixels = {1e6f, 1e6f};
  sums.sum[0] = sums.sum[3] = 1e6f;
  const LabelField field = FieldOf(mesh, sums);
  for (const float u : field.unary) EXPECT_TRUE(std::isfinite(u));
  EXPECT_EQ(SolveLabels(field, {2, 2}, {}).labels, (std::vector<int32_t>{0, 0}));
}

TEST(LabelField, PaperFormUsesSquareMetresAndUnnormalisedSums) {
  const TriangleMesh mesh = MakeGrid(1, 2, Eigen::Vector3d::UnitY());  // two faces of 2 m²
  FaceLikelihoods sums(2, 3);
  sums.pixels = {10, 10};
  sums.sum = {5, 3, 2, 5, 3, 2};
  LabelOptions options;
  options.form = LabelOptions::Form::kPaper;
  options.smoothness_weight = 0.5;
  const LabelField field = FieldOf(mesh, sums, options);
  EXPECT_NEAR(field.unary[0], -std::log(5.0), 1e-6);
  EXPECT_NEAR(field.unary[1], -std::log(3.0) + 0.35 * 2, 1e-6);
  ASSERT_EQ(field.edges.size(), 1u);
  EXPECT_NEAR(field.edges[0].weight, 0.5 * (2 + 2), 1e-6);
}

TEST(Unary, SumsEveryPixelAtAnyLikelihoodResolution) {
  FaceMap map;
  map.width = 4;
  map.height = 2;
  map.face = {0, 0, 1, -1, 0, 0, 1, 1};
  // Class 1 has 0.25 on the left and 0.75 on the right; the same image at half the resolution.
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
  // Bilinear between the two coarse pixels, whose centres are at 1 and 3 fine pixels.
  EXPECT_NEAR(half.sum[1], 2 * 0.25 + 2 * 0.375, 1e-6);
  EXPECT_NEAR(half.sum[3], 2 * 0.625 + 0.75, 1e-6);
}

TEST(Unary, StepsGiveTheBitsOfFloatsForOwnFaces) {
  FaceMap map;
  map.width = 4;
  map.height = 2;
  map.face = {0, 0, 1, -1, 0, 0, 1, 1};
  std::vector<uint8_t> steps;
  FloatImage likelihoods(2, 1, 2);
  for (const int step : {17, 201, 238, 54}) {
    steps.push_back(static_cast<uint8_t>(step));
    likelihoods.data[steps.size() - 1] = static_cast<float>(step) / 255;
  }
  FaceLikelihoods expected(2, 2), all(2, 2), own(2, 2);
  AddLikelihoods(map, likelihoods, {0.5, 0.5, 0, 0}, &expected);
  AddLikelihoods(map, {2, 1, steps}, {0.5, 0.5, 0, 0}, {}, &all);
  EXPECT_EQ(all.sum, expected.sum);
  EXPECT_EQ(all.pixels, expected.pixels);
  AddLikelihoods(map, {2, 1, steps}, {0.5, 0.5, 0, 0}, {0, 1}, &own);
  EXPECT_EQ(own.sum, (std::vector<float>{0, 0, expected.sum[2], expected.sum[3]}));
  EXPECT_EQ(own.pixels, (std::vector<float>{0, 3}));
}

TEST(Unary, SharesHaveEveryFaceOnce) {
  for (const int width : {400, 64, 1}) {
    FaceMap map;
    map.width = width;
    map.height = 4000 / width + 1;
    map.face.assign(static_cast<size_t>(map.width) * map.height, -1);
    for (int32_t f = 0; f < 4000; ++f) map.face[f] = f % 7 == 0 ? -1 : f / 2 * 2;
    std::vector<uint8_t> own(4000, 1);
    std::fill(own.begin() + 1000, own.begin() + 1100, 0);
    const std::vector<uint8_t> steps = {17, 201, 238, 54};
    const PixelMapping mapping = {2.0 / map.width, 1.0 / map.height, 0, 0};
    FaceLikelihoods all(4000, 2), shared(4000, 2);
    AddLikelihoods(map, {2, 1, steps}, mapping, own, &all);
    const FaceShares shares(map, own, 4);
    for (int share = 3; share >= 0; --share) {
      const std::vector<float> before = shared.pixels;
      AddLikelihoods(map, {2, 1, steps}, mapping, own, &shared, shares, share);
      EXPECT_NE(shared.pixels, before) << "no share is empty";
    }
    EXPECT_EQ(shared.pixels, all.pixels);
    EXPECT_EQ(shared.sum, all.sum);
  }
}

// Most of a map is passed over for one of many shares.
TEST(Unary, RunsOfPixelsKnowTheirShares) {
  FaceMap map;
  map.width = 130;
  map.height = 2;
  map.face.assign(260, -1);
  map.face[128] = 63 << 10;
  map.face[130 + 63] = 64 << 10;
  map.face[130 + 64] = 5;
  const FaceShares shares(map, {}, FaceShares::kMost);
  std::vector<uint8_t> not_5(65 << 10, 1);
  not_5[5] = 0;
  const FaceShares own(map, not_5, FaceShares::kMost);
  for (int share = 0; share < FaceShares::kMost; ++share) {
    for (int y = 0; y < 2; ++y) {
      for (int run = 0; run < 3; ++run) {
        const bool first = y == 1 && run == 0 && share == 0, second = y == 1 && run == 1 && share == 0;
        const bool last = y == 0 && run == 2 && share == 63;
        EXPECT_EQ(shares.InRun(share, y, run), first || second || last) << share << " " << y << " " << run;
        EXPECT_EQ(own.InRun(share, y, run), first || last) << share << " " << y << " " << run;
      }
    }
  }
}

}  // namespace
}  // namespace tessera
