#include "worker/photo/photo_term.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "common/base/machine_limits.h"
#include "common/base/parallel.h"
#include "tests/support/make_texels.h"
#include "tests/support/relief_scene.h"
#include "tests/unit/worker/photo/photo_oracle.h"
#include "worker/refine/descent.h"
#include "worker/refine/vertex_sums.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

using Eigen::Vector3d;
using Positions = std::vector<Vector3d>;

struct Evaluated : PhotoDerivatives {
  ZnccSums sums;
};

// A relief rendered and classified; the tested surface deviates by some decimetres (a pixel is about 0.14 m).
struct Scene {
  TriangleMesh truth = HeightField(60, 5, ReliefHeight);
  TriangleMesh mesh = HeightField(12, 4.5, ReliefHeight);
  std::vector<PhotoView> views;
  PhotoOptions options;

  explicit Scene(bool gaussian = true, int classes = 0, double gain = 1, double offset = 0) {
    Random random(4);
    for (Vector3d& v : mesh.vertices) v.z() += 0.15 * random.Normal();
    const std::vector<PosedCamera> cameras = ReliefCameras(120);
    for (size_t i = 0; i < cameras.size(); ++i) {
      FloatImage luminance = Photograph(truth, cameras[i], 0.9 + 0.05 * static_cast<double>(i), 0.01, 10 + i);
      if (i == 1) {
        for (float& value : luminance.data) value = static_cast<float>(gain * value + offset);
      }
      if (classes > 0) {
        FloatImage likelihoods = PhotographClasses(truth, cameras[i], classes);
        for (float& value : likelihoods.data) value = static_cast<float>(value * random.Uniform(0.9, 1.1));
        views.push_back({cameras[i], MakeTexels(luminance, likelihoods, PixelMapping())});
      } else {
        views.push_back({cameras[i], MakeTexels(luminance)});
      }
    }
    options.window = MakeWindow(7, gaussian);
    options.window.min_variance = 1e-4f;
    options.window.noise_variance = 4e-4f;
    options.window.outlier = std::numeric_limits<float>::infinity();
    options.occlusion_px = 3;
  }
  PhotoOracle Oracle(int i, int j) const { return PhotoOracle(mesh, views[i], views[j], options); }
  PhotoSums Faces(const std::vector<ViewPair>& pairs, const std::vector<uint8_t>& own = {}) const {
    PhotoSums out;
    std::vector<PhotoView> at_hand = views;
    PhotoTerm(&at_hand, options).Evaluate(pairs, mesh, own, nullptr, nullptr, &out);
    return out;
  }
  Evaluated Evaluate(const std::vector<ViewPair>& pairs) const {
    const PhotoSums faces = Faces(pairs);
    return {GatherVertices(mesh, FacesOfVertices(mesh), faces.faces, {}), faces.sums};
  }
};

struct Agreement {
  double median_relative_error = 0, cosine = 0;
};

// Compares vertices whose expected gradient is not negligible.
Agreement Compare(const Positions& expected, const Positions& got) {
  double largest = 0, dot = 0, e2 = 0, g2 = 0;
  for (const Vector3d& e : expected) largest = std::max(largest, e.norm());
  std::vector<double> errors;
  for (size_t v = 0; v < expected.size(); ++v) {
    dot += expected[v].dot(got[v]);
    e2 += expected[v].squaredNorm();
    g2 += got[v].squaredNorm();
    if (expected[v].norm() > 1e-3 * largest) errors.push_back((expected[v] - got[v]).norm() / expected[v].norm());
  }
  if (errors.size() < 50) return {1e9, 0};
  std::nth_element(errors.begin(), errors.begin() + errors.size() / 2, errors.end());
  return {errors[errors.size() / 2], dot / std::sqrt(e2 * g2)};
}

Positions FiniteDifferences(const PhotoOracle& oracle, Positions v) {
  constexpr double kStep_m = 1e-6;
  Positions gradient(v.size(), Vector3d::Zero());
  for (size_t k = 0; k < v.size(); ++k) {
    for (int axis = 0; axis < 3; ++axis) {
      const double at = v[k][axis];
      v[k][axis] = at + kStep_m;
      const double up = oracle.Energy(v);
      v[k][axis] = at - kStep_m;
      gradient[k][axis] = (up - oracle.Energy(v)) / (2 * kStep_m);
      v[k][axis] = at;
    }
  }
  return gradient;
}

// Parts of the energy, with and without the outlier function.
enum Terms { kPhoto, kSemantic, kBoth, kRobust };

class DataTerm : public testing::TestWithParam<Terms> {
 protected:
  static Scene MakeScene() {
    const Terms terms = GetParam();
    Scene scene(true, terms == kPhoto ? 0 : 5);
    if (terms != kPhoto) scene.options.semantic_weight = 3;
    // Reject all windows.
    if (terms == kSemantic) scene.options.window.min_variance = 10;
    if (terms == kRobust) scene.options.window.outlier = 0.3f;
    return scene;
  }
};

TEST_P(DataTerm, GradientIsTheDerivativeOfTheEnergy) {
  const Scene scene = MakeScene();
  const PhotoOracle oracle = scene.Oracle(1, 2);
  if (GetParam() != kSemantic) {
    ASSERT_GT(oracle.accepted_windows(), 1500);
  }
  ASSERT_GT(oracle.masked_pixels(), 1500);
  ASSERT_LT(oracle.masked_pixels(), 120 * 90 * 4 / 5);  // some are occluded or outside
  const Positions measured = FiniteDifferences(oracle, scene.mesh.vertices);
  const auto passes = [&](const Positions& gradient) {
    const Agreement agreement = Compare(measured, gradient);
    return agreement.median_relative_error < 1e-4 && agreement.cosine > 0.999;
  };
  const Agreement exact = Compare(measured, oracle.Gradient(scene.mesh.vertices));
  EXPECT_LT(exact.median_relative_error, 1e-4);
  EXPECT_GT(exact.cosine, 0.999);
  // The product's gradient passes the same check.
  const Agreement got = Compare(measured, scene.Evaluate({{1, 2}}).gradient);
  EXPECT_LT(got.median_relative_error, 1e-4);
  EXPECT_GT(got.cosine, 0.999);
  // Wrong formulas fail it.
  std::vector<PhotoOracle::Fault> faults = {PhotoOracle::kNoPerspective};
  if (GetParam() != kSemantic) faults.insert(faults.end(), {PhotoOracle::kPointwise, PhotoOracle::kNearestTexel});
  if (GetParam() != kPhoto) faults.push_back(PhotoOracle::kOneClassFewer);
  if (GetParam() == kRobust) faults.push_back(PhotoOracle::kNoOutlier);
  for (const PhotoOracle::Fault fault : faults) {
    EXPECT_FALSE(passes(oracle.Gradient(scene.mesh.vertices, fault))) << "fault " << fault;
  }
  Positions slightly = oracle.Gradient(scene.mesh.vertices);
  for (Vector3d& g : slightly) g *= 1.001;
  EXPECT_FALSE(passes(slightly));
}

TEST_P(DataTerm, NewtonStepLowersTheEnergy) {
  const Scene scene = MakeScene();
  const Evaluated got = scene.Evaluate({{0, 1}});
  Positions moved = scene.mesh.vertices;
  for (size_t v = 0; v < moved.size(); ++v) {
    const double stiffness = got.curvature[v].trace();
    if (stiffness > 0) moved[v] -= 0.5 * got.gradient[v] / stiffness;
  }
  const PhotoOracle oracle = scene.Oracle(0, 1);
  EXPECT_LT(oracle.Energy(moved), 0.95 * oracle.Energy(scene.mesh.vertices));
}

INSTANTIATE_TEST_SUITE_P(Terms, DataTerm, testing::Values(kPhoto, kSemantic, kBoth, kRobust));

class Kernel : public testing::TestWithParam<bool> {};

TEST_P(Kernel, MatchesTheOracle) {
  Scene scene(GetParam(), 5);
  scene.options.semantic_weight = 2;
  for (const ViewPair& pair : std::vector<ViewPair>{{0, 1}, {1, 2}, {2, 0}, {3, 1}}) {
    // With a single pair, no division by the number of pairs.
    const Evaluated got = scene.Evaluate({pair});
    const PhotoOracle oracle = scene.Oracle(pair.reference, pair.other);
    const Agreement agreement = Compare(oracle.Gradient(scene.mesh.vertices), got.gradient);
    EXPECT_LT(agreement.median_relative_error, 1e-4);
    EXPECT_GT(agreement.cosine, 0.9999);
    const double photo = oracle.PhotoEnergy(scene.mesh.vertices), semantic = oracle.SemanticEnergy(scene.mesh.vertices);
    EXPECT_NEAR(got.sums.energy, photo, 1e-3 * photo);
    EXPECT_NEAR(got.sums.semantic_energy, semantic, 1e-3 * semantic);
    EXPECT_NEAR(static_cast<double>(got.sums.windows), oracle.accepted_windows(), 5);
    EXPECT_NEAR(static_cast<double>(got.sums.semantic_pixels), oracle.masked_pixels(), 5);
  }
}

INSTANTIATE_TEST_SUITE_P(Windows, Kernel, testing::Bool());

TEST(PhotoTerm, GradientIsInvariantToTheGainOfAnImage) {
  Evaluated derivatives[2];
  for (int k = 0; k < 2; ++k) {
    Scene scene(true, 0, k == 0 ? 1 : 0.6, k == 0 ? 0 : 0.1);
    scene.options.window.epsilon = 0;
    scene.options.window.noise_variance = 0;
    scene.options.window.min_variance = 1e-6f;
    scene.options.window.max_variance_ratio = 1e6f;
    scene.options.window.max_mean_difference = 1;
    derivatives[k] = scene.Evaluate({{0, 1}});
  }
  EXPECT_GT(Compare(derivatives[0].gradient, derivatives[1].gradient).cosine, 0.9999);
  EXPECT_NEAR(derivatives[0].sums.energy, derivatives[1].sums.energy, 1e-2 * derivatives[0].sums.energy);
}

TEST(PhotoTerm, AViewWithoutLikelihoodsHasNoSemanticTerm) {
  Scene with(true, 4), without(true, 0);
  with.options.semantic_weight = without.options.semantic_weight = 2;
  with.views[2].texels = without.views[2].texels;
  EXPECT_GT(with.Evaluate({{0, 1}}).sums.semantic_pixels, 1000);
  const Evaluated mixed = with.Evaluate({{0, 2}}), none = without.Evaluate({{0, 2}});
  EXPECT_EQ(mixed.sums.semantic_pixels, 0);
  EXPECT_EQ(mixed.gradient, none.gradient);
}

TEST(PhotoTerm, ResultIsIndependentOfThreads) {
  Scene scene(true, 4);
  scene.options.semantic_weight = 2;
  const std::vector<ViewPair> pairs = {{0, 1}, {0, 2}, {1, 0}, {2, 0}, {3, 0}};
  Evaluated one;
  {
    ThreadLimit limit(1);
    one = scene.Evaluate(pairs);
  }
  for (int threads : {2, 5}) {
    ThreadLimit limit(threads);
    const Evaluated many = scene.Evaluate(pairs);
    EXPECT_EQ(one.gradient, many.gradient);
    EXPECT_EQ(one.curvature, many.curvature);
    EXPECT_EQ(one.pairs, many.pairs);
    EXPECT_EQ(one.sums.energy, many.sums.energy);
    EXPECT_EQ(one.sums.semantic_energy, many.sums.semantic_energy);
  }
}

// With cells, only those that own pixels may show are drawn, and only vertices of cells with own faces are projected.
TEST(PhotoTerm, CellsChangeNoSumOfOwnFaces) {
  Scene scene;
  for (PhotoView& view : scene.views) view.depths = {1, 100};
  const TriangleMesh& mesh = scene.mesh;
  constexpr uint32_t kCells = 12;
  MeshCells cells;
  ViewGroups groups;
  for (uint32_t c = 0; c <= kCells; ++c) {
    cells.face_begin.push_back(static_cast<uint32_t>(mesh.faces.size() * c / kCells));
    cells.vertex_begin.push_back(static_cast<uint32_t>(mesh.vertices.size() * c / kCells));
  }
  cells.vertex_cells.resize(kCells);
  FindVertexCells(mesh.faces, &cells);
  for (uint32_t f = 0; f < mesh.faces.size(); ++f) {
    const auto after = std::upper_bound(cells.face_begin.begin(), cells.face_begin.end(), f);
    groups.group_of_face.push_back(static_cast<uint32_t>(after - cells.face_begin.begin() - 1));
  }
  groups.selected.assign(kCells, std::vector<uint8_t>(scene.views.size(), 1));
  std::vector<uint8_t> own(mesh.faces.size(), 0);
  std::fill(own.begin() + cells.face_begin[4] + 5, own.begin() + cells.face_begin[7], 1);
  const std::vector<ViewPair> pairs = {{0, 1}, {0, 2}, {1, 0}, {2, 0}, {3, 0}};
  PhotoSums with;
  std::vector<PhotoView> at_hand = scene.views;
  PhotoTerm term(&at_hand, scene.options, &groups);
  term.Evaluate(pairs, mesh, {}, &cells, nullptr, &with);
  for (Vector3d& v : scene.mesh.vertices) v.z() += 0.2;  // what is kept from the first time is wrong now
  term.Evaluate(pairs, mesh, own, &cells, nullptr, &with);
  const PhotoSums without = scene.Faces(pairs, own);
  int64_t seen = 0;
  for (size_t f = 0; f < own.size(); ++f) {
    if (!own[f]) continue;
    seen += with.faces[f].pairs > 0;
    EXPECT_EQ(with.faces[f].gradient, without.faces[f].gradient) << "face " << f;
    EXPECT_EQ(with.faces[f].curvature, without.faces[f].curvature) << "face " << f;
    EXPECT_EQ(with.faces[f].pairs, without.faces[f].pairs) << "face " << f;
  }
  EXPECT_GT(seen, 30);
}

// Many threads evaluate several references together and open the views of the next ones meanwhile.
void CheckSumsOfManyReferences() {
  Scene scene;
  for (int i = 0; i < 8; ++i) scene.views.push_back(scene.views[i % 4]);
  std::vector<ViewPair> pairs;
  for (int i = 0; i < 12; ++i) {
    for (const int other : {i - 5, i - 1, i + 1, i + 5}) {
      if (i != 4 && other >= 0 && other < 12) pairs.push_back({i, other});
    }
  }
  std::vector<uint8_t> some(scene.mesh.faces.size());
  for (size_t f = 0; f < some.size(); ++f) some[f] = MeshSpans(scene.mesh).Centroid(f).x() > 0;
  for (const std::vector<uint8_t>& own : {std::vector<uint8_t>(), some}) {
    PhotoSums one;
    {
      ThreadLimit limit(1);
      one = scene.Faces(pairs, own);
    }
    for (const int threads : {2, 3, 16}) {
      ThreadLimit limit(threads);
      const PhotoSums many = scene.Faces(pairs, own);
      EXPECT_EQ(one.sums.energy, many.sums.energy);
      EXPECT_EQ(one.warped_pixels, many.warped_pixels);
      for (size_t f = 0; f < one.faces.size(); ++f) {
        if (!own.empty() && !own[f]) continue;
        ASSERT_EQ(one.faces[f].gradient, many.faces[f].gradient) << "face " << f << ", threads " << threads;
        ASSERT_EQ(one.faces[f].curvature, many.faces[f].curvature) << "face " << f << ", threads " << threads;
        ASSERT_EQ(one.faces[f].pairs, many.faces[f].pairs) << "face " << f << ", threads " << threads;
      }
    }
  }
}

TEST(PhotoTerm, SumsOfManyReferencesAreIndependentOfThreads) { CheckSumsOfManyReferences(); }

// In a process of its own, because the first call of LookaheadLimit_bytes decides.
TEST(PhotoTermDeathTest, ViewsThatDoNotFitTheMemoryTogetherAreOpenedInTurn) {
  testing::GTEST_FLAG(death_test_style) = "threadsafe";
  const auto check = [] {
    SetMemoryLimit(130'000);
    EXPECT_EQ(Rasterizer().MostAtOnce(Scene().mesh), 1u);
    CheckSumsOfManyReferences();
    return testing::Test::HasFailure() ? 1 : 7;
  };
  EXPECT_EXIT(std::exit(check()), testing::ExitedWithCode(7), "");
}

// The sums of own faces equal those of all faces, also when only the part of the mesh that their windows can show is
// given (here: all of it).
TEST(PhotoTerm, SumsOfOwnFacesEqualThoseOfAllFaces) {
  Scene scene(true, 4);
  scene.options.semantic_weight = 2;
  const std::vector<ViewPair> pairs = {{0, 1}, {0, 2}, {1, 0}, {2, 0}, {3, 0}};
  const PhotoSums all = scene.Faces(pairs);
  std::vector<uint8_t> own(scene.mesh.faces.size(), 0);
  int64_t compared = 0;
  for (size_t f = 0; f < own.size(); ++f) {
    const Vector3d at = MeshSpans(scene.mesh).Centroid(f);
    own[f] = at.x() > 0.5 && at.y() < 2;
  }
  const PhotoSums some = scene.Faces(pairs, own);
  EXPECT_LT(some.sums.windows, all.sums.windows / 2);
  for (size_t f = 0; f < own.size(); ++f) {
    if (!own[f]) continue;
    compared += all.faces[f].pairs > 0;
    EXPECT_EQ(all.faces[f].gradient, some.faces[f].gradient) << "face " << f;
    EXPECT_EQ(all.faces[f].curvature, some.faces[f].curvature) << "face " << f;
    EXPECT_EQ(all.faces[f].pairs, some.faces[f].pairs) << "face " << f;
  }
  EXPECT_GT(compared, 50);
}

}  // namespace
}  // namespace tessera
