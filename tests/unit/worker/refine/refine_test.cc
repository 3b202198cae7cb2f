// Whole runs of the geometry on photographs of hills.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "common/base/parallel.h"
#include "tests/support/held_pixels.h"
#include "tests/support/refine_surface.h"
#include "tests/support/relief_scene.h"
#include "worker/refine/density.h"

namespace tessera {
namespace {

using Eigen::Vector3d;
using Positions = std::vector<Vector3d>;

double Hills(double x, double y) { return 0.5 * std::sin(0.9 * x) * std::cos(0.8 * y); }

// Photographs of hills and a start surface that is off by about two pixels, smooth and rough.
struct Bed {
  SurfaceProblem problem;
  TileRefineOptions options;
  bool at_truth = false;  // where the energy has nothing to fall by, and smoothness takes a little

  explicit Bed(double error_m = 0.2, uint64_t seed = 2) : at_truth(error_m == 0) {
    const TriangleMesh truth = HeightField(80, 5, Hills);
    problem.mesh = HeightField(36, 4.2, Hills);
    Random random(seed);
    for (Vector3d& v : problem.mesh.vertices) {
      v.z() += error_m * (0.7 * std::sin(1.7 * v.x() + 1) + 0.5 * random.Normal());
    }
    const std::vector<PosedCamera> cameras = ReliefCameras(160);
    for (size_t i = 0; i < cameras.size(); ++i) {
      problem.views.push_back(
          {cameras[i], std::make_shared<HeldPixels>(Photograph(truth, cameras[i], 0.9 + 0.03 * i, 0.005, i))});
    }
    problem.gsd_m = 14.0 / (1.25 * 160);
    problem.levels = {1, 0};
    problem.iterations = {8, 8};
    options.step.grid_gsd = 1e-9;  // which lies elsewhere after a motion
  }
  static Bed ForAlike(bool accelerated, uint64_t seed = 2) {
    Bed bed(0.2, seed);
    if (accelerated) {
      bed.problem.iterations = {2, 2};
    } else {
      bed.options.step.acceleration = {};
    }
    return bed;
  }
  Positions Refine() const {
    const StatusOr<SurfaceRefinement> refined = RefineSurface(problem, options);
    EXPECT_TRUE(refined.ok()) << refined.status();
    if (!refined.ok()) return {};
    const auto round = nlohmann::json::parse(refined->tile.state.report).at("rounds").back();
    const double before = round.at("photo_energy_start"), after = round.at("photo_energy_end");
    EXPECT_LT(after, (at_truth ? 1.05 : 1) * before);
    return refined->vertices;
  }
};

// RMS height error over what lies well inside.
double Error(const Positions& vertices) {
  double sum = 0;
  int count = 0;
  for (const Vector3d& v : vertices) {
    if (std::max(std::abs(v.x()), std::abs(v.y())) > 3.2) continue;
    sum += std::pow(v.z() - Hills(v.x(), v.y()), 2);
    ++count;
  }
  return std::sqrt(sum / count);
}

TEST(Refine, FindsTheSurface) {
  const Bed bed;
  const double before = Error(bed.problem.mesh.vertices);
  const double after = Error(bed.Refine());
  EXPECT_LT(after, 0.15 * before);
  EXPECT_LT(after, 0.3 * bed.problem.gsd_m);
}

TEST(Refine, StaysAtTheTrueSurface) {
  const Bed bed(0);
  EXPECT_LT(Error(bed.Refine()), 0.15 * bed.problem.gsd_m);
}

TEST(Refine, IsEqualForAnyNumberOfThreads) {
  const Bed bed;
  Positions one, two;
  {
    ThreadLimit limit(1);
    one = bed.Refine();
  }
  {
    ThreadLimit limit(2);
    two = bed.Refine();
  }
  EXPECT_EQ(one, two);
}

// Rounding may take a vertex that stands at a limit another way, so single vertices differ by more. Returns the median
// difference in GSD.
double ExpectAlike(const Positions& expected, const Positions& found, double gsd_m, double max_rms_gsd) {
  EXPECT_EQ(expected.size(), found.size());
  std::vector<double> difference;
  double sum = 0;
  for (size_t v = 0; v < found.size(); ++v) {
    difference.push_back((expected[v] - found[v]).norm());
    sum += difference.back() * difference.back();
  }
  std::sort(difference.begin(), difference.end());
  EXPECT_LT(std::sqrt(sum / static_cast<double>(found.size())), max_rms_gsd * gsd_m);
  return difference[difference.size() / 2] / gsd_m;
}

// How far rounding may carry a bed: the RMS of all vertices and the median, in GSD.
struct Alike {
  bool accelerated;
  double max_rms_gsd;
  double max_median_gsd;
};

// Sixteen steps magnify rounding in some beds until most vertices show it, so half of several beds must not. Steps with
// momentum magnify it further each time, so of those there are four, two a level, in which it stays what it was.
template <class Body>
void ExpectMostAlike(const Body& median_of_bed) {
  for (const Alike& alike : {Alike{false, 0.02, 2e-3}, Alike{true, 1e-3, 1e-4}}) {
    std::vector<double> medians;
    for (uint64_t seed = 2; seed < 7; ++seed) {
      medians.push_back(median_of_bed(Bed::ForAlike(alike.accelerated, seed), alike.max_rms_gsd));
    }
    std::sort(medians.begin(), medians.end());
    EXPECT_LT(medians[medians.size() / 2], alike.max_median_gsd);
  }
}

TEST(Refine, CommutesWithARigidMotion) {
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.7, Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  const Vector3d shift(10, -20, 5);
  ExpectMostAlike([&](Bed bed, double max_rms_gsd) {
    Positions expected = bed.Refine();
    for (Vector3d& v : expected) v = turn * v + shift;
    for (Vector3d& v : bed.problem.mesh.vertices) v = turn * v + shift;
    for (RefineView& view : bed.problem.views) {
      view.camera.rotation_cam_from_world = view.camera.rotation_cam_from_world * turn.transpose();
      view.camera.translation_cam_from_world -= view.camera.rotation_cam_from_world * shift;
    }
    bed.problem.up = turn * bed.problem.up;
    return ExpectAlike(expected, bed.Refine(), bed.problem.gsd_m, max_rms_gsd);
  });
}

// By a power of two nothing rounds otherwise; by another factor every depth and slope in single precision does, and 16
// steps carry that further than a motion, which leaves depths alone.
TEST(Refine, CommutesWithScaling) {
  for (const auto& [scale, alike] : {std::pair(8.0, Alike{false, 0.02, 1e-3}), std::pair(7.3, Alike{false, 0.05, 0.02}),
                                     std::pair(8.0, Alike{true, 1e-3, 1e-4})}) {
    Bed scaled = Bed::ForAlike(alike.accelerated);
    Positions expected = scaled.Refine();
    for (Vector3d& v : expected) v *= scale;
    for (Vector3d& v : scaled.problem.mesh.vertices) v *= scale;
    for (RefineView& view : scaled.problem.views) view.camera.translation_cam_from_world *= scale;
    scaled.problem.gsd_m *= scale;
    EXPECT_LT(ExpectAlike(expected, scaled.Refine(), scaled.problem.gsd_m, alike.max_rms_gsd), alike.max_median_gsd);
  }
}

TEST(Refine, CommutesWithTheOrderOfCameras) {
  ExpectMostAlike([](Bed bed, double max_rms_gsd) {
    const Positions expected = bed.Refine();
    std::reverse(bed.problem.views.begin(), bed.problem.views.end());
    return ExpectAlike(expected, bed.Refine(), bed.problem.gsd_m, max_rms_gsd);
  });
}

TEST(Refine, StepsEndOnTheGrid) {
  Bed bed;
  bed.options.step.grid_gsd = 0.01;
  const double grid_m = std::exp2(std::floor(std::log2(0.01 * bed.problem.gsd_m)));
  const Positions out = bed.Refine();
  int on_grid = 0;
  for (const Vector3d& v : out) on_grid += (v / grid_m).array().round().matrix() * grid_m == v;
  EXPECT_GT(on_grid, 0.9 * static_cast<double>(out.size())) << "all but where faces would have folded";
}

TEST(Refine, BoundaryVerticesStay) {
  Bed bed;
  bed.problem.boundary.assign(bed.problem.mesh.vertices.size(), 0);
  for (size_t v = 0; v < 300; ++v) bed.problem.boundary[v] = 1;
  const Positions out = bed.Refine();
  size_t moved = 0;
  for (size_t v = 0; v < out.size(); ++v) {
    if (v < 300) {
      EXPECT_EQ(out[v], bed.problem.mesh.vertices[v]);
    }
    moved += out[v] != bed.problem.mesh.vertices[v];
  }
  EXPECT_GT(moved, 500u);
}

TEST(Refine, FarPartsDoNotSteerEachOther) {
  // The same part, with and without a second sheet far beside it that is in other views alone.
  const Bed bed;
  Bed wide;
  const Vector3d away(400, 0, 0);
  const uint32_t base = static_cast<uint32_t>(wide.problem.mesh.vertices.size());
  for (const Vector3d& v : bed.problem.mesh.vertices) wide.problem.mesh.vertices.push_back(v + away);
  for (const Triangle& f : bed.problem.mesh.faces) {
    wide.problem.mesh.faces.push_back({f[0] + base, f[1] + base, f[2] + base});
  }
  for (const RefineView& view : bed.problem.views) {
    RefineView other = view;
    other.camera.translation_cam_from_world -= other.camera.rotation_cam_from_world * away;
    wide.problem.views.push_back(other);
  }
  const Positions alone = bed.Refine(), together = wide.Refine();
  for (size_t v = 0; v < alone.size(); ++v) ASSERT_EQ(alone[v], together[v]);
}

TEST(Refine, StopsWhenCancelled) {
  const Bed bed;
  const TaskControl stop{nullptr, [] { return true; }};
  EXPECT_EQ(RefineSurface(bed.problem, bed.options, stop).status().code(), absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace tessera
