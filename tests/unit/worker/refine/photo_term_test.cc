#include "worker/refine/photo_term.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "common/base/parallel.h"
#include "tests/unit/worker/refine/photo_oracle.h"
#include "tests/unit/worker/refine/relief_scene.h"

namespace tessera {
namespace {

using Eigen::Vector3d;
using Positions = std::vector<Vector3d>;

// True relief photographed; the surface under test is off by some decimetres (pixels: about 0.14 m).
struct Scene {
  TriangleMesh truth = HeightField(60, 5, ReliefHeight);
  TriangleMesh mesh = HeightField(12, 4.5, ReliefHeight);
  std::vector<PosedCamera> cameras = ReliefCameras(120);
  std::vector<FloatImage> images;
  PhotoOptions options;

  explicit Scene(bool gaussian = true) {
    Random random(4);
    for (Vector3d& v : mesh.vertices) v.z() += 0.15 * random.Normal();
    for (size_t i = 0; i < cameras.size(); ++i) {
      images.push_back(Photograph(truth, cameras[i], 0.9 + 0.05 * static_cast<double>(i), 0.01, 10 + i));
    }
    options.window = MakeWindow(7, gaussian);
    options.window.epsilon = 1e-6f;
    options.window.min_variance = 1e-4f;
    options.window.noise_variance = 4e-4f;
    options.window.max_mean_difference = 0.3f;
    options.window.max_variance_ratio = 10;
    options.occlusion_px = 3;
  }
  PhotoOracle Oracle(int i, int j) const {
    return PhotoOracle(mesh, cameras[i], images[i], cameras[j], images[j], options);
  }
};

struct Agreement {
  double median_relative_error = 0, cosine = 0;
};

// Over the vertices whose expected gradient is not negligible.
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

TEST(PhotoTerm, OracleIsTheDerivativeOfTheWindowedScore) {
  const Scene scene;
  const PhotoOracle oracle = scene.Oracle(1, 2);
  ASSERT_GT(oracle.accepted_windows(), 1500);
  ASSERT_LT(oracle.masked_pixels(), 120 * 90 * 4 / 5);  // something is hidden or outside
  const Positions measured = FiniteDifferences(oracle, scene.mesh.vertices);
  const Agreement exact = Compare(measured, oracle.Gradient(scene.mesh.vertices));
  EXPECT_LT(exact.median_relative_error, 1e-4);
  EXPECT_GT(exact.cosine, 0.999);
  // The derivative that leaves out the other windows a pixel is in is told apart.
  const Agreement pointwise = Compare(measured, oracle.Gradient(scene.mesh.vertices, true));
  EXPECT_GT(pointwise.median_relative_error, 0.05);
  EXPECT_LT(pointwise.cosine, 0.99);
}

class Kernel : public testing::TestWithParam<bool> {};

TEST_P(Kernel, AgreesWithTheOracle) {
  const Scene scene(GetParam());
  std::vector<PhotoView> views;
  for (size_t i = 0; i < scene.cameras.size(); ++i) {
    views.push_back({scene.cameras[i], MakeTexels(scene.images[i])});
  }
  const std::vector<ViewPair> pairs = {{0, 1}, {1, 2}, {2, 0}, {3, 1}};
  for (const ViewPair& pair : pairs) {
    const std::vector<ViewPair> one = {pair};
    PhotoTerm term(views, one, scene.options);
    PhotoDerivatives got;
    term.Evaluate(scene.mesh, TriangleMesh(), nullptr, &got);
    // With one pair there is nothing to divide by.
    const PhotoOracle oracle = scene.Oracle(pair.reference, pair.other);
    const Agreement agreement = Compare(oracle.Gradient(scene.mesh.vertices), got.gradient);
    EXPECT_LT(agreement.median_relative_error, 1e-3);
    EXPECT_GT(agreement.cosine, 0.9999);
    EXPECT_NEAR(got.sums.energy, oracle.Energy(scene.mesh.vertices), 1e-3 * got.sums.energy);
    EXPECT_NEAR(static_cast<double>(got.sums.windows), oracle.accepted_windows(), 5);
  }
}

INSTANTIATE_TEST_SUITE_P(Windows, Kernel, testing::Bool());

TEST(PhotoTerm, AStepByTheCurvatureLowersTheEnergy) {
  const Scene scene;
  std::vector<PhotoView> views;
  for (size_t i = 0; i < 2; ++i) views.push_back({scene.cameras[i], MakeTexels(scene.images[i])});
  const std::vector<ViewPair> pairs = {{0, 1}};
  PhotoTerm term(views, pairs, scene.options);
  PhotoDerivatives got;
  term.Evaluate(scene.mesh, TriangleMesh(), nullptr, &got);
  Positions moved = scene.mesh.vertices;
  for (size_t v = 0; v < moved.size(); ++v) {
    const double stiffness = got.curvature[v].trace();
    if (stiffness > 0) moved[v] -= 0.5 * got.gradient[v] / stiffness;
  }
  const PhotoOracle oracle = scene.Oracle(0, 1);
  EXPECT_LT(oracle.Energy(moved), 0.95 * oracle.Energy(scene.mesh.vertices));
}

TEST(PhotoTerm, AGainOfOneImageChangesNoGradient) {
  Scene scene;
  scene.options.window.epsilon = 0;
  scene.options.window.noise_variance = 0;
  scene.options.window.min_variance = 1e-6f;
  scene.options.window.max_variance_ratio = 1e6f;
  scene.options.window.max_mean_difference = 1;
  const std::vector<ViewPair> pairs = {{0, 1}};
  PhotoDerivatives plain, darker;
  for (PhotoDerivatives* out : {&plain, &darker}) {
    std::vector<PhotoView> views;
    for (size_t i = 0; i < 2; ++i) views.push_back({scene.cameras[i], MakeTexels(scene.images[i])});
    PhotoTerm(views, pairs, scene.options).Evaluate(scene.mesh, TriangleMesh(), nullptr, out);
    for (float& value : scene.images[1].data) value = 0.6f * value + 0.1f;
  }
  EXPECT_GT(Compare(plain.gradient, darker.gradient).cosine, 0.9999);
  EXPECT_NEAR(plain.sums.energy, darker.sums.energy, 1e-2 * plain.sums.energy);
}

TEST(PhotoTerm, DoesNotDependOnThreads) {
  const Scene scene;
  std::vector<PhotoView> views;
  for (size_t i = 0; i < scene.cameras.size(); ++i) {
    views.push_back({scene.cameras[i], MakeTexels(scene.images[i])});
  }
  const std::vector<ViewPair> pairs = {{0, 1}, {0, 2}, {1, 0}, {2, 0}, {3, 0}};
  PhotoDerivatives one, two;
  {
    ThreadLimit limit(1);
    PhotoTerm(views, pairs, scene.options).Evaluate(scene.mesh, TriangleMesh(), nullptr, &one);
  }
  {
    ThreadLimit limit(2);
    PhotoTerm(views, pairs, scene.options).Evaluate(scene.mesh, TriangleMesh(), nullptr, &two);
  }
  EXPECT_EQ(one.gradient, two.gradient);
  EXPECT_EQ(one.curvature, two.curvature);
  EXPECT_EQ(one.sums.energy, two.sums.energy);
}

}  // namespace
}  // namespace tessera
