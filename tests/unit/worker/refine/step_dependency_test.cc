// Dependency radius of a vertex's step: a mesh cut at the radius, and a mesh changed at random everywhere outside it,
// give the same bytes as the whole. Random reliefs, settings and cores.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>

#include "common/base/random.h"
#include "tests/unit/worker/refine/random_reliefs.h"
#include "worker/refine/descent.h"
#include "worker/refine/self_intersection.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

// The arguments of ComputeStep.
struct StepInput {
  TriangleMesh mesh;  // current positions, with labels
  Positions start;
  std::vector<uint8_t> fixed;
  PhotoDerivatives photo;
  std::vector<Eigen::Vector3f> last;  // may be empty
  std::vector<ClassSmoothness> classes;
  double mixed = 0;
  CreaseWeights creases;
  MotionLimits limits;
  StepOptions options;

  Positions Step() const {
    const TriangleMesh from{start, mesh.faces, {}};
    SmoothTerm smooth(from, fixed);
    smooth.SetLabels(mesh.labels, classes, mixed);
    smooth.Reweight(mesh.vertices, creases);
    InterTerm inter(from, fixed);
    inter.SetLabels(mesh.labels);
    return ComputeStep(mesh.vertices, photo, smooth, &inter, MotionGuard(from, fixed, limits), options, last);
  }
};

Eigen::Matrix3d RandomCurvature(Random& random) {
  const Vector3d across = RandomVector(random);
  return Magnitude(random, 1e-3, 10) * across * across.transpose();
}

StepInput RandomStep(Random& random) {
  StepInput in;
  in.mesh = RandomRelief(random, 150);
  in.start = in.mesh.vertices;
  const size_t n = in.start.size();
  const double moved = Magnitude(random, 0.01, 0.5), pull = Magnitude(random, 0.01, 10);
  const double fixed = Chance(random, 0.5) ? 0.05 : 0;
  for (size_t v = 0; v < n; ++v) {
    in.mesh.vertices[v] += moved * RandomVector(random);
    in.fixed.push_back(Chance(random, fixed));
    in.photo.gradient.push_back(pull * RandomVector(random));
    in.photo.curvature.push_back(RandomCurvature(random));
    in.photo.pairs.push_back(Chance(random, 0.3) ? 0.0f : 1.0f);
  }
  for (int i = static_cast<int>(random.Below(5)); i > 0; --i) {
    in.classes.push_back({Magnitude(random, 0.01, 100), Chance(random, 0.5) ? Magnitude(random, 0.01, 10) : 0});
  }
  const auto weight = [&] { return Chance(random, 0.3) ? 0.0 : Magnitude(random, 1e-3, 30); };
  in.mixed = Chance(random, 0.3) ? 0 : random.Uniform();
  in.options.weights = {weight(), weight(), weight(), weight()};
  in.options.inter = weight();
  if (Chance(random, 0.7)) in.creases = {Magnitude(random, 0.01, 1), random.Uniform(0, 3), random.Uniform(0, 8)};
  in.options.smoothing_sweeps = static_cast<int>(random.Below(Chance(random, 0.7) ? 5 : 31));
  in.options.grid_m = Chance(random, 0.5) ? 0 : std::exp2(-static_cast<double>(random.Below(12)));
  in.options.max_step_m = Magnitude(random, 0.05, 5);
  if (Chance(random, 0.7)) in.options.acceleration = {random.Uniform(1, 2), random.Uniform()};
  in.options.half_effect_curvature = weight();
  for (size_t v = 0; in.options.acceleration.momentum > 0 && v < n; ++v) {
    in.last.push_back((moved * RandomVector(random)).cast<float>());
  }
  in.options.min_turn_cosine = random.Uniform(-1, 0.95);
  in.options.up = RandomVector(random).normalized();
  in.limits.start_smoothing_steps = static_cast<int>(random.Below(9));
  in.limits.min_start_cosine = random.Uniform(-1, 0.5);
  in.limits.free_share = random.Uniform();
  if (Chance(random, 0.7)) in.limits.max_normal_m = Magnitude(random, 0.1, 10);
  if (Chance(random, 0.7)) in.limits.max_tangent_m = Magnitude(random, 0.1, 10);
  return in;
}

// Number of core vertices that differ if the mesh is cut at `rings`, or changed outside them.
struct Differing {
  int64_t cut = 0, changed = 0;
  bool ends_inside = false;  // the mesh extends beyond the radius
};
Differing BeyondStep(const StepInput& in, const Positions& whole, const std::vector<uint8_t>& core, int rings,
                     Random& random) {
  const std::vector<int> from_core = RingsFrom(in.mesh.faces, FacesOfVertices(in.mesh), core);
  const std::vector<uint8_t> kept = FacesWithin(in.mesh.faces, from_core, rings - 1);
  Differing out;
  out.ends_inside = std::count(kept.begin(), kept.end(), 0) > 0;

  const Part part(in.mesh, kept);
  StepInput small = in;
  small.mesh = part.Mesh(in.mesh);
  small.start = part.OfVertices(in.start);
  small.fixed = part.OfVertices(in.fixed);
  small.photo.gradient = part.OfVertices(in.photo.gradient);
  small.photo.curvature = part.OfVertices(in.photo.curvature);
  small.photo.pairs = part.OfVertices(in.photo.pairs);
  if (!in.last.empty()) small.last = part.OfVertices(in.last);
  // A tile flags the vertices at its cut.
  const bool flagged = Chance(random, 0.5);
  for (size_t i = 0; flagged && i < part.vertices.size(); ++i) {
    if (from_core[part.vertices[i]] >= rings) small.fixed[i] = 1;
  }
  out.cut = Differences(whole, small.Step(), &part, core);

  StepInput other = in;
  for (size_t v = 0; v < core.size(); ++v) {
    if (from_core[v] <= rings) continue;
    other.mesh.vertices[v] += 0.3 * RandomVector(random);
    other.start[v] += 0.3 * RandomVector(random);
    other.fixed[v] = Chance(random, 0.2);
    other.photo.gradient[v] = 3 * RandomVector(random);
    other.photo.curvature[v] = RandomCurvature(random);
    other.photo.pairs[v] = 1 - in.photo.pairs[v];
    if (!in.last.empty()) other.last[v] = RandomVector(random).cast<float>();
  }
  for (size_t f = 0; f < kept.size(); ++f) {
    if (!kept[f]) other.mesh.labels[f] = static_cast<int32_t>(random.Below(5)) - 1;
  }
  out.changed = Differences(whole, other.Step(), nullptr, core);
  return out;
}

TEST(StepDependency, NothingOutsideTheRadiusMatters) {
  int ending_inside = 0;
  for (uint64_t seed = 0; seed < 400; ++seed) {
    Random random(seed);
    const StepInput in = RandomStep(random);
    const std::vector<uint8_t> core = RandomCore(in.mesh, FacesOfVertices(in.mesh), random);
    const int rings = StepDependencyRadiusOf(in.options.smoothing_sweeps, in.limits).rings();
    const Differing differing = BeyondStep(in, in.Step(), core, rings, random);
    ending_inside += differing.ends_inside;
    ASSERT_EQ(differing.cut, 0) << "seed " << seed;
    ASSERT_EQ(differing.changed, 0) << "seed " << seed;
  }
  EXPECT_GT(ending_inside, 300);
}

// Each part of the bound is attained: with one ring less, bytes differ.
TEST(StepDependency, RadiusIsAttained) {
  int sweeps = 0, start = 0;
  for (uint64_t seed = 0; seed < 60; ++seed) {
    Random random(seed);
    StepInput in = RandomStep(random);
    in.options.min_turn_cosine = in.limits.min_start_cosine = -1;
    in.options.grid_m = 0;
    in.options.max_step_m = 1e-4;  // prevents folds
    in.options.smoothing_sweeps = 1 + static_cast<int>(seed % 3);
    in.limits.start_smoothing_steps = 2;
    in.limits.max_normal_m = in.limits.max_tangent_m = std::numeric_limits<double>::infinity();
    const std::vector<uint8_t> core = RandomCore(in.mesh, FacesOfVertices(in.mesh), random);
    StepDependencyRadius reach = StepDependencyRadiusOf(in.options.smoothing_sweeps, in.limits);
    reach.folding = 0;
    ASSERT_EQ(BeyondStep(in, in.Step(), core, reach.rings(), random).changed, 0) << seed;
    if (reach.gradient + reach.sweeps > reach.start) {
      sweeps += BeyondStep(in, in.Step(), core, reach.rings() - 1, random).changed > 0;
    }
    in.options.smoothing_sweeps = 1;
    in.limits.start_smoothing_steps = 4;
    in.limits.max_normal_m = in.limits.max_tangent_m = 0.5;
    in.limits.max_normal_m = 0.1;
    in.limits.free_share = 0;
    reach = StepDependencyRadiusOf(in.options.smoothing_sweeps, in.limits);
    reach.folding = 0;
    ASSERT_EQ(BeyondStep(in, in.Step(), core, reach.rings(), random).changed, 0) << seed;
    start += BeyondStep(in, in.Step(), core, reach.rings() - 1, random).changed > 0;
  }
  EXPECT_GT(sweeps, 5);
  EXPECT_GT(start, 5);
}

TEST(StepDependency, FoldingPassDependsOnOneRing) {
  int farthest = 0;  // largest ring with an effect
  for (uint64_t seed = 0; seed < 100; ++seed) {
    Random random(seed);
    const TriangleMesh mesh = RandomRelief(random, 60);
    MotionLimits limits;
    limits.start_smoothing_steps = 0;  // start normals are the faces' own
    const MotionGuard guard(mesh, {}, limits);
    Positions wanted;
    const double length = Magnitude(random, 0.05, 3);
    for (size_t v = 0; v < mesh.vertices.size(); ++v) wanted.push_back(length * RandomVector(random));
    const std::vector<uint8_t> core = RandomCore(mesh, guard.faces_of_vertex(), random);
    const std::vector<int> from_core = RingsFrom(mesh.faces, guard.faces_of_vertex(), core);
    Positions whole = wanted;
    guard.LimitFolding(mesh.vertices, 0.4, &whole);
    for (int rings = 0; rings <= MotionGuard::kFoldingPasses; ++rings) {
      Positions other = wanted;
      for (size_t v = 0; v < other.size(); ++v) {
        if (from_core[v] > rings) other[v] = length * RandomVector(random);
      }
      guard.LimitFolding(mesh.vertices, 0.4, &other);
      if (Differences(whole, other, nullptr, core) > 0) farthest = std::max(farthest, rings);
    }
    ASSERT_LT(farthest, MotionGuard::kFoldingPasses) << seed;
  }
  RecordProperty("farthest", farthest);
  EXPECT_GE(farthest, MotionGuard::kSmoothingPasses);
}

// No vertex is ever farther from its start than MotionBound_m.
TEST(MotionBound, HoldsForAllSteps) {
  double nearest = 0;  // smallest distance to the bound, relative to it
  for (uint64_t seed = 0; seed < 60; ++seed) {
    Random random(seed);
    StepInput in = RandomStep(random);
    in.limits.max_normal_m = Magnitude(random, 0.05, 3);
    in.limits.max_tangent_m = Magnitude(random, 0.05, 3);
    const double bound = MotionBound_m(in.limits);
    const TriangleMesh start{in.start, in.mesh.faces, {}};
    const MotionGuard guard(start, in.fixed, in.limits);
    in.mesh.vertices = guard.RepairedStart();
    SurfaceRepair repair(start, guard.faces_of_vertex());
    const auto check = [&] {
      for (size_t v = 0; v < in.start.size(); ++v) {
        const double moved = (in.mesh.vertices[v] - in.start[v]).norm();
        ASSERT_LE(moved, bound) << "seed " << seed;
        nearest = std::max(nearest, moved / bound);
      }
    };
    check();
    const Positions unfolded = in.mesh.vertices;
    for (int step = 0; step < 12; ++step) {
      const Positions steps = in.Step();
      for (size_t v = 0; v < steps.size(); ++v) in.mesh.vertices[v] += steps[v];
      check();
    }
    const auto keeps_facing = [&](uint32_t face, const auto& from, const auto& to) {
      return guard.KeepsOrientation(face, from, to);
    };
    repair.Run(unfolded, keeps_facing, &in.mesh.vertices);
    check();
  }
  EXPECT_GT(nearest, 0.9);
}

}  // namespace
}  // namespace tessera
