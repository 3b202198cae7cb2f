// Whole runs on a relief with a block that hangs over, on photographs that are true, exchanged, or nothing but noise:
// no face turns, none cuts another anew, no vertex flies off.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "tests/support/held_pixels.h"
#include "tests/support/refine_surface.h"
#include "tests/support/relief_scene.h"
#include "tests/unit/worker/refine/cgal_pairs.h"
#include "worker/refine/density.h"
#include "worker/refine/descent.h"

namespace tessera {
namespace {

using Eigen::Vector3d;
using Positions = std::vector<Vector3d>;

// Heights in steps, and the block wider at its top than at its foot.
TriangleMesh BlockyOverhang() {
  TriangleMesh mesh = HeightField(48, 4.5, ReliefHeight);
  for (Vector3d& v : mesh.vertices) {
    v.z() = 0.2 * std::round(v.z() / 0.2);
    const Vector3d out(v.x() - 1, v.y(), 0);
    if (v.z() > 0.7 && out.norm() > 1) v += 0.25 * (v.z() - 0.7) * out.normalized();
  }
  return mesh;
}

enum class Photographs { kTrue, kExchanged, kNoise };

struct SafetyScene {
  SurfaceProblem problem;
  TileRefineOptions options;

  explicit SafetyScene(Photographs photographs) {
    const TriangleMesh truth = HeightField(90, 5, ReliefHeight);
    const std::vector<PosedCamera> cameras = ReliefCameras(160);
    std::vector<FloatImage> images;
    for (size_t i = 0; i < cameras.size(); ++i) {
      images.push_back(Photograph(truth, cameras[i], 1, 0.005, i));
      if (photographs != Photographs::kNoise) continue;
      Random random(10 + i);
      for (float& value : images.back().data) value = static_cast<float>(0.5 + 0.2 * random.Normal());
    }
    if (photographs == Photographs::kExchanged) std::rotate(images.begin(), images.begin() + 1, images.end());
    problem.mesh = SplitLargeFaces(BlockyOverhang(), cameras, {}).mesh;
    for (size_t i = 0; i < cameras.size(); ++i)
      problem.views.push_back({cameras[i], std::make_shared<HeldPixels>(images[i])});
    problem.gsd_m = 14.0 / (1.25 * 160);
    problem.levels = {2, 1, 0};
    problem.iterations = {8, 8, 8};
  }
  Positions Refine() const {
    const StatusOr<SurfaceRefinement> refined = RefineSurface(problem, options);
    EXPECT_TRUE(refined.ok()) << refined.status();
    return refined.ok() ? refined->vertices : Positions();
  }
  MotionGuard Guard() const {
    MotionLimits limits;
    limits.start_smoothing_steps = options.step.start_smoothing_steps;
    return MotionGuard(problem.mesh, {}, limits);
  }
};

class SurfaceSafety : public testing::TestWithParam<Photographs> {};

TEST_P(SurfaceSafety, NothingTurnsCutsOrFlies) {
  const SafetyScene scene(GetParam());
  const Positions& start = scene.problem.mesh.vertices;
  const Positions end = scene.Refine();
  EXPECT_EQ(scene.Guard().InvertedFaces(end), 0);
  const std::vector<FacePair> before = PairsByCgal(scene.problem.mesh);
  EXPECT_EQ(NewPairs(before, PairsByCgal({end, scene.problem.mesh.faces, {}})), std::vector<FacePair>());
  const double reach = std::max(scene.options.step.max_normal_gsd, scene.options.step.max_tangent_gsd) *
                       scene.problem.gsd_m * (1 + 1e-9);
  double moved = 0;
  for (size_t v = 0; v < end.size(); ++v) {
    EXPECT_LE((end[v] - start[v]).norm(), reach);
    moved += (end[v] - start[v]).norm() / static_cast<double>(end.size());
  }
  EXPECT_GT(moved, 0.3 * scene.problem.gsd_m);  // it is not safe because it stands still
}

// The limits count from where the job began, not from where a round did.
TEST_P(SurfaceSafety, RoundsKeepToTheFirstStart) {
  SafetyScene scene(GetParam());
  const MotionGuard guard = scene.Guard();
  const std::vector<FacePair> before = PairsByCgal(scene.problem.mesh);
  SafetyScene rounds(GetParam()), runs(GetParam());
  rounds.problem.rounds = 3;
  const TriangleMesh end = {rounds.Refine(), scene.problem.mesh.faces, {}};
  EXPECT_EQ(guard.InvertedFaces(end.vertices), 0);
  EXPECT_EQ(NewPairs(before, PairsByCgal(end)), std::vector<FacePair>());
  // Three runs that each take the result before as their start turn faces.
  for (int run = 0; run < 3; ++run) runs.problem.mesh.vertices = runs.Refine();
  EXPECT_GT(guard.InvertedFaces(runs.problem.mesh.vertices), 0);
}

TEST_P(SurfaceSafety, ItIsTheLimitsThatHold) {
  SafetyScene scene(GetParam());
  scene.options.step.min_start_cosine = -1;
  EXPECT_GT(scene.Guard().InvertedFaces(scene.Refine()), 0);
}

TEST_P(SurfaceSafety, OneThreadIsAsManyByteForByte) {
  const SafetyScene scene(GetParam());
  Positions one, many;
  {
    const ThreadLimit limit(1);
    one = scene.Refine();
  }
  {
    const ThreadLimit limit(4);
    many = scene.Refine();
  }
  EXPECT_EQ(one, many);
}

INSTANTIATE_TEST_SUITE_P(Photographs, SurfaceSafety,
                         testing::Values(Photographs::kTrue, Photographs::kExchanged, Photographs::kNoise));

}  // namespace
}  // namespace tessera
