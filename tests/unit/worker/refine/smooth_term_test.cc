#include "worker/refine/smooth_term.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "tests/support/relief_scene.h"

namespace tessera {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Positions = std::vector<Vector3d>;

TriangleMesh Bumpy(uint64_t seed) {
  Random random(seed);
  TriangleMesh mesh = HeightField(8, 4, [&](double, double) { return 0.4 * random.Normal(); });
  // Irregular degrees.
  mesh.faces[20] = {mesh.faces[20][1], mesh.faces[20][2], mesh.faces[20][0]};
  return mesh;
}

TEST(SmoothTerm, GradientIsTheDerivativeOfTheEnergy) {
  const TriangleMesh mesh = Bumpy(1);
  const SmoothTerm term(mesh, {});
  const SmoothWeights weights{0.7, 0.2, 0.4};
  Random random(5);
  Positions v = mesh.vertices;
  for (Vector3d& p : v) p += 0.3 * Vector3d(random.Normal(), random.Normal(), random.Normal());
  Positions gradient;
  term.Gradient(v, weights, &gradient);
  double largest = 0;
  for (size_t k = 0; k < v.size(); ++k) {
    for (int axis = 0; axis < 3; ++axis) {
      const double at = v[k][axis], h = 1e-4;
      v[k][axis] = at + h;
      const double up = term.Energy(v, weights);
      v[k][axis] = at - h;
      const double down = term.Energy(v, weights);
      v[k][axis] = at;
      EXPECT_NEAR(gradient[k][axis], (up - down) / (2 * h), 1e-7);
      largest = std::max(largest, std::abs(gradient[k][axis]));
    }
  }
  EXPECT_GT(largest, 0.1);
}

TEST(SmoothTerm, PlaneHasNoGradient) {
  const TriangleMesh mesh = HeightField(8, 4, [](double x, double y) { return 0.3 * x - 0.2 * y; });
  const SmoothTerm term(mesh, {});
  Positions gradient;
  term.Gradient(mesh.vertices, {1, 0, 1}, &gradient);
  for (const Vector3d& g : gradient) EXPECT_LT(g.norm(), 1e-12);
}

TEST(SmoothTerm, UniformMotionOfTheBoundaryHasNoGradient) {
  TriangleMesh mesh = HeightField(6, 3, [](double x, double y) { return 0.1 * x * x - 0.2 * y; });
  const SmoothTerm term(mesh, {});
  Positions moved = mesh.vertices, gradient;
  for (Vector3d& v : moved) v.z() += 0.7;
  term.Gradient(moved, {0, 0, 1}, &gradient);
  for (size_t v = 0; v < gradient.size(); ++v) {
    EXPECT_LT(gradient[v].norm(), 1e-12);
    EXPECT_EQ(term.on_boundary(v), std::abs(std::abs(mesh.vertices[v].x()) - 3) < 1e-9 ||
                                       std::abs(std::abs(mesh.vertices[v].y()) - 3) < 1e-9);
  }
}

TEST(SmoothTerm, SolvesForTheStep) {
  const TriangleMesh mesh = Bumpy(2);
  std::vector<uint8_t> fixed(mesh.vertices.size());
  fixed[30] = 1;
  const SmoothTerm term(mesh, fixed);
  const SmoothWeights weights{1, 0.1, 0.3};
  Random random(3);
  std::vector<Matrix3d> data;
  Positions rhs;
  for (size_t v = 0; v < mesh.vertices.size(); ++v) {
    const Vector3d n = Vector3d(random.Normal(), random.Normal(), random.Normal()).normalized();
    data.push_back(2 * n * n.transpose() + 0.5 * Matrix3d::Identity());
    rhs.push_back(fixed[v] ? Vector3d(1, 1, 1) : Vector3d(random.Normal(), random.Normal(), random.Normal()));
  }
  Positions step;
  term.SolveStep(data, rhs, weights, 120, &step);
  EXPECT_EQ(step[30], Vector3d::Zero());
  // (data + A) step = rhs; A step is the gradient at start + step minus that at the start.
  Positions moved = mesh.vertices, at_start, at_step;
  for (size_t v = 0; v < moved.size(); ++v) moved[v] += step[v];
  term.Gradient(mesh.vertices, weights, &at_start);
  term.Gradient(moved, weights, &at_step);
  for (size_t v = 0; v < moved.size(); ++v) {
    if (fixed[v]) continue;
    EXPECT_LT((data[v] * step[v] + at_step[v] - at_start[v] - rhs[v]).norm(), 1e-3) << v;
  }
}

TEST(SmoothTerm, SolveStepPropagatesTwoRingsPerSweep) {
  const TriangleMesh mesh = HeightField(30, 15, [](double, double) { return 0.0; });
  const SmoothTerm term(mesh, {});
  const std::vector<Matrix3d> data(mesh.vertices.size(), Matrix3d::Zero());
  Positions rhs(mesh.vertices.size(), Vector3d::Zero()), step;
  const size_t centre = 15 * 31 + 15;
  rhs[centre] = Vector3d(0, 0, 1);
  constexpr int kSweeps = 4;
  term.SolveStep(data, rhs, {1, 0, 0}, kSweeps, &step);
  EXPECT_GT(step[centre].z(), 0);
  int farthest = 0;
  for (size_t v = 0; v < step.size(); ++v) {
    const int dx = static_cast<int>(v % 31) - 15, dy = static_cast<int>(v / 31) - 15;
    if (step[v] != Vector3d::Zero()) farthest = std::max({farthest, std::abs(dx), std::abs(dy)});
  }
  EXPECT_EQ(farthest, SmoothTerm::SolveRings(kSweeps));
}

}  // namespace
}  // namespace tessera
