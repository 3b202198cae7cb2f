#include "common/scene/fit_change.h"

#include <cmath>
#include <optional>
#include <utility>

#include "common/base/parallel.h"
#include "common/geometry/ray_caster.h"
#include "common/scene/fit_pairs.h"

namespace tessera {
namespace {

constexpr float kClearChange = 0.03f;  // of a ZNCC
constexpr double kWorseShare = 0.1, kWorseDeviations = 5, kSharedPatches = 2;

// Where the ray of the reference through `point` meets the mesh.
std::optional<SurfacePoint> OnMesh(const TriangleMesh& mesh, const RayCaster& caster, const PosedCamera& reference,
                                   const SurfacePoint& point) {
  const Eigen::Vector3d centre = reference.Centre(), ray = point.position - centre;
  const RayHit hit = caster.Cast(centre, ray);
  if (!hit.hit()) return std::nullopt;
  const Eigen::Vector3d normal = FaceNormal(mesh, static_cast<size_t>(hit.face));
  if (!(normal.dot(ray) < 0)) return std::nullopt;
  return SurfacePoint{centre + hit.distance * ray, normal};
}

}  // namespace

bool BecameWorse(std::span<const PatchChange> patches) {
  double worse = 0, better = 0;
  for (const PatchChange& patch : patches) {
    worse += patch.after < patch.before - kClearChange;
    better += patch.after > patch.before + kClearChange;
  }
  return worse - better > kWorseShare * static_cast<double>(patches.size()) &&
         worse - better > kWorseDeviations * std::sqrt(kSharedPatches * (worse + better));
}

StatusOr<FitChange> CompareFits(const SceneDescription& scene, const TriangleMesh& start, const TriangleMesh& result,
                                const FitOptions& options, const TaskControl& control) {
  TESSERA_ASSIGN_OR_RETURN(
      const std::vector<FitPair> pairs,
      FindFitPairs(scene, SpreadPoints(start, FitPointsFor(scene)), RayCaster(start), 0, options, control));
  const RayCaster caster(result);
  FitImages images(scene);
  std::vector<FitMatches> before(pairs.size()), after(pairs.size());
  FitChange change;
  TESSERA_RETURN_IF_ERROR(ForEachFitPair(pairs, &images, control, [&](size_t p) {
    const FitPair& pair = pairs[p];
    const PatchView reference = images.At(scene, pair.reference), other = images.At(scene, pair.other);
    const auto seed = static_cast<uint32_t>(p * 1000);
    const std::vector<std::optional<PatchMatch>> first = MatchPoints(reference, other, pair.points, seed);
    std::vector<std::optional<PatchMatch>> second(pair.points.size());
    std::vector<std::optional<SurfacePoint>> moved(pair.points.size());
    ParallelForEach(pair.points.size(), 16, [&](size_t i) {
      if (!first[i]) return;
      moved[i] = OnMesh(result, caster, scene.views[pair.reference].camera, pair.points[i]);
      if (moved[i]) second[i] = MatchPatch(reference, other, *moved[i], seed + static_cast<uint32_t>(i));
    });
    before[p] = after[p] = {pair.reference, pair.other, images.Scale(pair.reference), {}};
    for (size_t i = 0; i < first.size(); ++i) {
      if (!first[i] || !second[i]) continue;
      before[p].matches.push_back({pair.points[i], *first[i]});
      after[p].matches.push_back({*moved[i], *second[i]});
      change.patches.push_back({pair.reference, pair.other, pair.points[i].position,
                                static_cast<float>(first[i]->correlation), static_cast<float>(second[i]->correlation)});
    }
  }));
  change.start = SumUpFit(scene, before);
  change.result = SumUpFit(scene, after);
  change.worse = BecameWorse(change.patches);
  std::vector<std::vector<PatchChange>> of_view(scene.views.size());
  for (const PatchChange& patch : change.patches) {
    for (const int view : {patch.reference, patch.other}) of_view[view].push_back(patch);
  }
  for (size_t v = 0; v < of_view.size(); ++v) {
    if (BecameWorse(of_view[v])) change.worse_views.push_back(static_cast<int>(v));
  }
  return change;
}

}  // namespace tessera
