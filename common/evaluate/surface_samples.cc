#include "common/evaluate/surface_samples.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "common/base/parallel.h"
#include "common/base/random.h"

namespace tessera {
namespace {

constexpr double kRayMargin = 2e-4;  // relative to the distance to the camera

bool IsSeen(const Eigen::Vector3d& point, const RayCaster& caster, const std::vector<SceneView>& views, int min_views) {
  int seen = 0;
  for (size_t i = 0; i < views.size() && seen < min_views; ++i) {
    const PosedCamera& camera = views[i].camera;
    if (!camera.InImage(camera.Project(point))) continue;
    const Eigen::Vector3d centre = camera.Centre();
    if (!caster.Occluded(centre, point, kRayMargin * (centre - point).norm())) ++seen;
  }
  return seen >= min_views;
}

}  // namespace

// Stratified sampling has a lower variance than independent points, so small differences between meshes are measurable.
// The square root gives uniform barycentric coordinates (Osada et al., Shape distributions, 2002, eq. 1).
std::vector<SurfaceSample> SampleByArea(const TriangleMesh& mesh, int64_t count, uint64_t seed) {
  std::vector<double> area_up_to(mesh.faces.size());
  double total = 0;
  for (size_t f = 0; f < mesh.faces.size(); ++f) area_up_to[f] = total += FaceArea(mesh, f);
  std::vector<SurfaceSample> samples;
  if (!(total > 0)) return samples;
  samples.reserve(count);
  Random random(seed);
  size_t face = 0;
  for (int64_t i = 0; i < count; ++i) {
    const double target = (static_cast<double>(i) + random.Uniform()) / static_cast<double>(count) * total;
    while (face + 1 < mesh.faces.size() && area_up_to[face] <= target) ++face;
    const double root = std::sqrt(random.Uniform()), second = random.Uniform();
    samples.push_back({(1 - root) * mesh.Corner(face, 0) + root * (1 - second) * mesh.Corner(face, 1) +
                           root * second * mesh.Corner(face, 2),
                       static_cast<uint32_t>(face)});
  }
  return samples;
}

std::vector<SurfaceSample> SeenSamples(const std::vector<SurfaceSample>& samples, const RayCaster& caster,
                                       const std::vector<SceneView>& views, int min_views) {
  std::vector<uint8_t> seen(samples.size());
  ParallelForEach(samples.size(), 256, [&](size_t i) { seen[i] = IsSeen(samples[i].point, caster, views, min_views); });
  std::vector<SurfaceSample> kept;
  for (size_t i = 0; i < samples.size(); ++i) {
    if (seen[i]) kept.push_back(samples[i]);
  }
  return kept;
}

}  // namespace tessera
