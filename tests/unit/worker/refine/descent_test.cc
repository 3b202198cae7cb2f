#include "worker/refine/descent.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "tests/support/relief_scene.h"
#include "worker/refine/stepper.h"

namespace tessera {
namespace {

using Eigen::Vector3d;
using Positions = std::vector<Vector3d>;

double Flat(double, double) { return 0.0; }

Positions Added(Positions at, const Positions& step) {
  for (size_t v = 0; v < at.size(); ++v) at[v] += step[v];
  return at;
}

Positions RandomSteps(size_t count, double sigma, uint64_t seed) {
  Random random(seed);
  Positions step(count);
  for (Vector3d& s : step) s = sigma * Vector3d(random.Normal(), random.Normal(), random.Normal());
  return step;
}

// Voxel staircase: blocks of `block` cells at heights that are multiples of the cell's width.
TriangleMesh Stairs(int n, double half_m) {
  TriangleMesh mesh = HeightField(n, half_m, Flat);
  const double cell = 2 * half_m / n;
  for (Vector3d& v : mesh.vertices) v.z() = cell * std::round(1.5 * std::sin(0.9 * v.x()) * std::cos(v.y()) / cell);
  return mesh;
}

// New labels leave nothing of the old ones behind.
TEST(Stepper, SetLabelsGivesTheStepsOfANewStepper) {
  TriangleMesh start = Stairs(20, 5), other = start;
  Random random(9);
  for (size_t f = 0; f < start.faces.size(); ++f) {
    start.labels.push_back(static_cast<int32_t>(random.Below(3)));
    other.labels.push_back(static_cast<int32_t>(f / 40 % 3));
  }
  StepperOptions options;
  options.classes = {{.smoothness = 0.5}, {.smoothness = 2}, {.smoothness = 1, .anchor = 3}};
  options.creases.bend = 0.3;
  options.inter = 0.5;
  PhotoDerivatives data;
  data.gradient = RandomSteps(start.vertices.size(), 1, 4);
  data.curvature.assign(start.vertices.size(), Eigen::Matrix3d::Identity());
  data.pairs.assign(start.vertices.size(), 1);
  const TriangleMesh mesh = {Added(start.vertices, RandomSteps(start.vertices.size(), 0.01, 5)), start.faces, {}};
  const auto step = [&](Stepper& stepper) { return stepper.Step(mesh.vertices, data, 0, 1, {}); };
  Stepper changed(start, start.labels, {}, 0.1, Vector3d::UnitZ(), options),
      made(other, other.labels, {}, 0.1, Vector3d::UnitZ(), options);
  const Positions before = step(changed), expected = step(made);
  EXPECT_NE(before, expected) << "the labels matter";
  changed.SetLabels(other.labels);
  EXPECT_EQ(step(changed), expected);
  changed.SetLabels({});
  Stepper unlabelled(start, {}, {}, 0.1, Vector3d::UnitZ(), options);
  EXPECT_EQ(step(changed), step(unlabelled));
}

// The cuts of the fine part of a job rely on this bound.
TEST(Stepper, NoStepIsLongerThanItsBound) {
  const double gsd_m = 0.1;
  const TriangleMesh start = HeightField(12, 2, Flat);
  const size_t n = start.vertices.size();
  StepperOptions options;
  options.max_normal_gsd = options.max_tangent_gsd = 1000;
  double longest = 0;  // / bound
  for (int level = 0; level < 3; ++level) {
    for (int iteration = 0; iteration < 8; iteration += 3) {
      const auto seed = static_cast<uint64_t>(10 * level + iteration);
      const TriangleMesh mesh = {Added(start.vertices, RandomSteps(n, 0.02, seed)), start.faces, {}};
      PhotoDerivatives data;
      data.gradient = RandomSteps(n, 1e6, seed + 1);
      data.curvature.assign(n, Eigen::Matrix3d::Identity());
      data.pairs.assign(n, 1);
      std::vector<Eigen::Vector3f> last;
      for (const Vector3d& step : RandomSteps(n, 10, seed + 2)) last.push_back(step.cast<float>());
      Stepper stepper(start, start.labels, {}, gsd_m, Vector3d::UnitZ(), options);
      const double bound_m = LongestStep_m(options, gsd_m, level, iteration);
      for (const Vector3d& step : stepper.Step(mesh.vertices, data, level, iteration, last)) {
        longest = std::max(longest, step.norm() / bound_m);
      }
    }
  }
  EXPECT_LE(longest, 1);
  EXPECT_GT(longest, 0.98);
}

// Even a ragged boundary must not shrink: a small retreat per step would remove it after some rounds.
TEST(Stepper, GroundBoundaryStaysInPlanAndWallBoundaryMayMove) {
  TriangleMesh ground = Stairs(24, 6);
  Random random(7);
  for (Vector3d& v : ground.vertices) v += 0.1 * Vector3d(random.Normal(), random.Normal(), random.Normal());
  StepperOptions options;
  const auto moved = [&](const TriangleMesh& start, const Vector3d& pull) {
    Stepper stepper(start, start.labels, {}, 0.1, Vector3d::UnitZ(), options);
    TriangleMesh mesh = {start.vertices, start.faces, {}};
    PhotoDerivatives data;
    data.gradient.assign(start.vertices.size(), -pull);
    data.curvature.assign(start.vertices.size(), Eigen::Matrix3d::Identity());
    data.pairs.assign(start.vertices.size(), 1);
    for (int i = 0; i < 20; ++i) mesh.vertices = Added(mesh.vertices, stepper.Step(mesh.vertices, data, 0, 0, {}));
    return mesh.vertices;
  };
  const Positions after = moved(ground, Vector3d::Zero());
  const CsrRows faces = FacesOfVertices(ground);
  const MotionGuard guard(ground, {}, MakeMotionLimits(options, 0.1));
  const SmoothTerm smooth(ground, {});
  int boundary = 0;
  double inside = 0;
  for (size_t v = 0; v < after.size(); ++v) {
    const double in_plan = (after[v] - ground.vertices[v]).head<2>().norm();
    if (!smooth.on_boundary(v)) {
      inside = std::max(inside, in_plan);
    } else if (std::abs(guard.start_normal(v).z()) > std::sqrt(0.5)) {
      ++boundary;
      // Steps end on a grid.
      EXPECT_LE(in_plan, 20 * options.grid_gsd * 0.1) << "vertex " << v;
    }
  }
  EXPECT_GT(boundary, 40);
  EXPECT_GT(inside, 0.1) << "the surface inside is smoothed: the test shows something";

  TriangleMesh wall = HeightField(12, 3, Flat);
  for (Vector3d& v : wall.vertices) v = {v.x(), 0, v.y()};
  const Positions lower = moved(wall, Vector3d(0, 0, -2));
  for (size_t v = 0; v < lower.size(); ++v) EXPECT_LT(lower[v].z(), wall.vertices[v].z() - 0.01) << v;
}

// With data evidence a step is over-relaxed and includes momentum, in proportion to the evidence. Without evidence
// neither has an effect, and fixed vertices stay.
TEST(ComputeStep, MomentumActsOnlyWithDataEvidence) {
  const TriangleMesh mesh = HeightField(12, 6, Flat);
  const size_t n = mesh.vertices.size();
  std::vector<uint8_t> fixed(n);
  PhotoDerivatives data;
  data.gradient.assign(n, Vector3d(0.01, 0, -0.02));
  data.pairs.assign(n, 1);
  std::vector<Eigen::Vector3f> last;
  for (size_t v = 0; v < n; ++v) {
    fixed[v] = v % 7 == 3;
    data.curvature.push_back(v % 2 == 0 ? Eigen::Matrix3d::Zero() : Eigen::Matrix3d(Eigen::Matrix3d::Identity()));
    last.push_back({0.01f, -0.02f, 0.03f * static_cast<float>(v % 5)});
  }
  const SmoothTerm smooth(mesh, fixed);
  const InterTerm inter(mesh, fixed);
  MotionLimits limits;
  limits.max_normal_m = limits.max_tangent_m = 1e3;
  const MotionGuard guard(mesh, fixed, limits);
  StepOptions options;
  options.weights = {1, 0.1, 0, 0};
  options.max_step_m = 1e3;
  options.min_turn_cosine = -1;  // no step is limited
  const Positions plain = ComputeStep(mesh.vertices, data, smooth, &inter, guard, options);
  options.acceleration = {1.5, 0.8};
  options.half_effect_curvature = 2;
  const Positions with = ComputeStep(mesh.vertices, data, smooth, &inter, guard, options, last);
  const Positions first = ComputeStep(mesh.vertices, data, smooth, &inter, guard, options);  // no previous step
  const double share = 3.0 / (3 + 2);                                              // the trace of the curvature
  int moving = 0;
  for (size_t v = 0; v < n; ++v) {
    if (smooth.on_boundary(v)) continue;
    if (fixed[v] || v % 2 == 0) {
      EXPECT_EQ(with[v], plain[v]) << "vertex " << v;
      EXPECT_EQ(fixed[v] && !with[v].isZero(0), false) << "vertex " << v;
      continue;
    }
    ++moving;
    EXPECT_LT((first[v] - (1 + share * 0.5) * plain[v]).norm(), 1e-12) << "vertex " << v;
    EXPECT_LT((with[v] - first[v] - share * 0.8 * last[v].cast<double>()).norm(), 1e-12) << "vertex " << v;
  }
  EXPECT_GT(moving, 30);
}

TEST(SmoothedPositions, SmoothsStairsAndKeepsBoundaryAndFixedVertices) {
  const TriangleMesh mesh = Stairs(20, 4);
  std::vector<uint8_t> fixed(mesh.vertices.size());
  fixed[10 * 21 + 7] = 1;
  const Positions smooth = SmoothedPositions(mesh, FacesOfVertices(mesh), fixed, 5);
  double roughness = 0, before = 0;
  for (int y = 1; y < 20; ++y) {
    for (int x = 1; x < 20; ++x) {
      const size_t v = y * 21 + x;
      roughness += std::abs(smooth[v].z() - 0.5 * (smooth[v - 1].z() + smooth[v + 1].z()));
      before += std::abs(mesh.vertices[v].z() - 0.5 * (mesh.vertices[v - 1].z() + mesh.vertices[v + 1].z()));
    }
  }
  EXPECT_LT(roughness, 0.5 * before);
  for (size_t i = 0; i <= 20; ++i) {
    for (size_t v : {i, 20 * 21 + i, 21 * i, 21 * i + 20}) EXPECT_EQ(smooth[v], mesh.vertices[v]);
  }
  EXPECT_EQ(smooth[10 * 21 + 7], mesh.vertices[10 * 21 + 7]);
}

TEST(MotionGuard, FoldingStepsAreShortened) {
  const TriangleMesh mesh = HeightField(6, 3, Flat);
  Positions step(mesh.vertices.size(), Vector3d::Zero());
  step[24] = Vector3d(2.5, 0, 0);  // across its neighbours
  step[8] = Vector3d(0, 0, 0.1);
  MotionGuard(mesh, {}, {}).LimitFolding(mesh.vertices, 0.4, &step);
  const TriangleMesh moved{Added(mesh.vertices, step), mesh.faces, {}};
  for (size_t f = 0; f < mesh.faces.size(); ++f) EXPECT_GE(FaceNormal(moved, f).dot(FaceNormal(mesh, f)), 0.4 - 1e-12);
  EXPECT_GT(step[24].x(), 0);
  EXPECT_EQ(step[8].z(), 0.1);
}

// Few faces fold after any step. SurfaceRepair undoes the motion of faces inverted against the start.
TEST(MotionGuard, FewFacesFoldAfterAnyStep) {
  for (uint64_t seed = 0; seed < 6; ++seed) {
    const TriangleMesh mesh = Stairs(30, 4);
    const Positions wanted = RandomSteps(mesh.vertices.size(), 0.05 * static_cast<double>(1 << seed), seed);
    Positions step = wanted;
    const MotionGuard guard(mesh, {}, {});
    guard.LimitFolding(mesh.vertices, 0.4, &step);
    const TriangleMesh moved{Added(mesh.vertices, step), mesh.faces, {}};
    const auto folds = [&](const Positions& at) {
      const TriangleMesh after{at, mesh.faces, {}};
      int64_t count = 0;
      for (size_t f = 0; f < mesh.faces.size(); ++f) {
        count += FaceNormal(after, f).dot(FaceNormal(mesh, f)) < 0.4 - 1e-9 ||
                 FaceArea(after, f) < 0.1 * FaceArea(mesh, f) * (1 - 1e-9) ||
                 !guard.KeepsOrientation(static_cast<uint32_t>(f), mesh.vertices, at);
      }
      return count;
    };
    EXPECT_LE(folds(moved.vertices), folds(Added(mesh.vertices, wanted)) / 50) << seed;
    double longest = 0;
    for (const Vector3d& s : wanted) longest = std::max(longest, s.norm());
    for (const Vector3d& s : step) ASSERT_LE(s.norm(), longest);
  }
}

// Steps that each turn faces slightly in the same direction must never invert a face.
TEST(MotionGuard, SmallStepsNeverInvertAFace) {
  const TriangleMesh start = HeightField(8, 4, Flat);
  const Vector3d centre(0.05, 0.02, 0);
  const auto fold = [&](double min_start_cosine) {
    MotionLimits limits;
    limits.min_start_cosine = min_start_cosine;
    const MotionGuard guard(start, {}, limits);
    TriangleMesh mesh = start;
    for (int i = 0; i < 60; ++i) {
      Positions step(mesh.vertices.size(), Vector3d::Zero());
      for (int v : {39, 40, 41}) step[v] = 0.08 * Vector3d(0.4, 1, i % 2 ? 0.9 : 0.5);  // a fan that is rolled over
      guard.LimitFolding(mesh.vertices, 0.4, &step);
      mesh.vertices = Added(mesh.vertices, step);
    }
    return guard.InvertedFaces(mesh.vertices);
  };
  EXPECT_GT(fold(-1), 0);
  EXPECT_EQ(fold(0.1), 0);
}

TEST(MotionGuard, InvertedFaceOfTheStartMayOnlyImprove) {
  // A bent spike: some faces are inverted in the start, but not in the smoothed start.
  TriangleMesh start = HeightField(10, 5, Flat);
  start.vertices[60] += Vector3d(1.6, 0.3, 0.8);
  const MotionGuard guard(start, {}, {});
  ASSERT_GT(guard.InvertedFaces(start.vertices), 0);
  for (const double way : {1.0, -1.0}) {
    Positions step(start.vertices.size(), Vector3d::Zero());
    step[60] = way * Vector3d(-0.3, -0.06, 0.1);
    guard.LimitFolding(start.vertices, -1, &step);
    const Positions end = Added(start.vertices, step);
    for (uint32_t f = 0; f < start.faces.size(); ++f) EXPECT_TRUE(guard.KeepsOrientation(f, start.vertices, end));
    if (way > 0) {
      EXPECT_GT(step[60].norm(), 0.3);
    }
  }
}

TEST(MotionGuard, RepairsInvertedFacesOfTheStart) {
  TriangleMesh start = HeightField(10, 5, Flat);
  start.vertices[60] += Vector3d(1.6, 0.3, 0.8);
  const MotionGuard guard(start, {}, {});
  ASSERT_GT(guard.InvertedFaces(start.vertices), 0);
  const Positions unfolded = guard.RepairedStart();
  EXPECT_EQ(guard.InvertedFaces(unfolded), 0);
  for (size_t v = 0; v < 30; ++v) EXPECT_EQ(unfolded[v], start.vertices[v]);
  const TriangleMesh stairs = Stairs(20, 4);
  EXPECT_EQ(MotionGuard(stairs, {}, {}).RepairedStart(), stairs.vertices);
}

TEST(MotionGuard, AveragingGivesFixedVerticesNoStep) {
  const TriangleMesh mesh = HeightField(10, 5, Flat);
  std::vector<uint8_t> fixed(mesh.vertices.size());
  Positions step = RandomSteps(mesh.vertices.size(), 0.6, 4);
  for (size_t v = 0; v < fixed.size(); v += 3) {
    fixed[v] = 1;
    step[v].setZero();
  }
  MotionGuard(mesh, fixed, {}).LimitFolding(mesh.vertices, 0.4, &step);
  for (size_t v = 0; v < fixed.size(); v += 3) EXPECT_EQ(step[v], Vector3d::Zero());
}

TEST(MotionGuard, VertexStopsAtItsEllipsoid) {
  const TriangleMesh start = HeightField(8, 4, Flat);
  MotionLimits limits;
  limits.max_normal_m = 1;
  limits.max_tangent_m = 0.25;
  const MotionGuard guard(start, {}, limits);
  for (const Vector3d& pull : {Vector3d(0, 0, 0.1), Vector3d(0.1, 0, 0), Vector3d(-0.06, 0.08, -0.1)}) {
    Positions at = start.vertices;
    double farthest = 0, first = 0;
    for (int i = 0; i < 200; ++i) {
      Positions step(at.size(), Vector3d::Zero());
      step[40] = pull;
      guard.LimitDisplacement(at, &step);
      if (i == 0) first = step[40].norm();
      at = Added(at, step);
      const Vector3d d = at[40] - start.vertices[40];
      farthest = std::max(farthest, std::hypot(d.z() / 1, d.head<2>().norm() / 0.25));
    }
    EXPECT_LE(farthest, 1 + 1e-9);
    EXPECT_GT(farthest, 0.95);
    EXPECT_DOUBLE_EQ(first, pull.norm());  // free near the start
    // Motion back towards the start is not damped.
    Positions back(at.size(), Vector3d::Zero());
    back[40] = -pull;
    guard.LimitDisplacement(at, &back);
    EXPECT_EQ(back[40], -pull);
  }
}

// As a vertex of the second split, which lies between two that have moved.
TEST(MotionGuard, VertexThatBeginsOutsideItsEllipsoidStaysWithinTheBound) {
  const TriangleMesh start = HeightField(8, 4, Flat);
  MotionLimits limits;
  limits.max_normal_m = 1;
  limits.max_tangent_m = 0.75;
  const MotionGuard guard(start, {}, limits);
  const double bound_m = MotionBound_m(limits);
  for (const Vector3d& pull : {Vector3d(-0.05, 0, 0.2), Vector3d(0.1, 0.1, 0), Vector3d(-0.3, 0, 0.75)}) {
    Positions at = start.vertices;
    at[40].x() += 0.95;
    for (int i = 0; i < 50; ++i) {
      Positions step(at.size(), Vector3d::Zero());
      step[40] = pull;
      guard.LimitDisplacement(at, &step);
      at = Added(at, step);
      ASSERT_LE((at[40] - start.vertices[40]).norm(), bound_m);
    }
    Positions inwards(at.size(), Vector3d::Zero());
    inwards[40] = 0.5 * (start.vertices[40] - at[40]);
    const Vector3d wanted = inwards[40];
    guard.LimitDisplacement(at, &inwards);
    EXPECT_EQ(inwards[40], wanted);
  }
  // Steps along the larger ellipsoid through the vertex, which reaches farther along the normal.
  Positions at = start.vertices;
  at[40].x() += 0.95;
  for (int i = 0; i < 400; ++i) {
    const Vector3d from = at[40] - start.vertices[40];
    Positions step(at.size(), Vector3d::Zero());
    step[40] = 0.01 * Vector3d(-from.z(), 0, from.x() / 0.5625) - 0.001 * from;
    guard.LimitDisplacement(at, &step);
    at = Added(at, step);
    ASSERT_LE((at[40] - start.vertices[40]).norm(), bound_m) << i;
  }
}

TEST(MotionGuard, ResultIsIndependentOfThreads) {
  const TriangleMesh mesh = Stairs(120, 4);
  MotionLimits limits;
  limits.max_normal_m = 0.1;
  limits.max_tangent_m = 0.05;
  const auto limited = [&](int threads) {
    const ThreadLimit limit(threads);
    Positions step = RandomSteps(mesh.vertices.size(), 0.05, 3);
    const MotionGuard guard(mesh, {}, limits);
    guard.LimitDisplacement(mesh.vertices, &step);
    guard.LimitFolding(mesh.vertices, 0.4, &step);
    return step;
  };
  EXPECT_EQ(limited(1), limited(2));
}

}  // namespace
}  // namespace tessera
