#include "common/synth/photos/sparse_points.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "common/base/parallel.h"
#include "common/base/random.h"

namespace tessera {

std::vector<SparsePoint> MakeSparsePoints(const CityScene& scene, const std::vector<SynthView>& flight,
                                          const std::vector<int>& views, int count, uint64_t seed) {
  std::vector<std::optional<SparsePoint>> found(count);
  ParallelForEach(count, 16, [&](int64_t k) {
    Random random(MixBits(seed) ^ static_cast<uint64_t>(k));
    const PosedCamera& from = flight[views[random.Below(static_cast<int64_t>(views.size()))]].camera;
    const Eigen::Vector3d origin = from.Centre();
    const Eigen::Vector3d ray =
        from.Ray(random.Uniform(0, from.intrinsics.width), random.Uniform(0, from.intrinsics.height));
    const RayHit hit = scene.caster().Cast(origin, ray);
    if (!hit.hit()) return;
    const Eigen::Vector3d p = origin + hit.distance * ray;
    SparsePoint point;
    const double spread = 0.08 * scene.plan().gsd_m;
    point.position =
        p + spread * Eigen::Vector3d(random.Normal(), random.Normal(), random.Normal()).cwiseMax(-2.0).cwiseMin(2.0);
    const Eigen::Vector3f color = scene.Radiance(hit, origin, ray);
    for (int c = 0; c < 3; ++c) {
      point.color_rgb[c] = static_cast<uint8_t>(255 * std::pow(std::clamp(color[c], 0.f, 1.f), 1.f / 2.2f));
    }
    point.error_px = 0;
    for (int view : views) {
      const PosedCamera& camera = flight[view].camera;
      const Eigen::Vector3d seen = camera.Project(p);
      if (!camera.InImage(seen) || scene.caster().Occluded(p, camera.Centre(), 0.03)) continue;
      if (random.Uniform() < 0.15) continue;  // simulates a missing match
      const double dx = std::clamp(0.22 * random.Normal(), -0.5, 0.5),
                   dy = std::clamp(0.22 * random.Normal(), -0.5, 0.5);
      const double x = seen.x() + dx, y = seen.y() + dy;
      if (x < 0 || y < 0 || x >= camera.intrinsics.width || y >= camera.intrinsics.height) continue;
      point.track.push_back({view, x, y});
      point.error_px += (camera.Project(point.position).head<2>() - Eigen::Vector2d(x, y)).norm();
    }
    if (point.track.size() < 3) return;
    point.error_px /= static_cast<double>(point.track.size());
    found[k] = std::move(point);
  });
  std::vector<SparsePoint> points;
  for (auto& point : found) {
    if (point) points.push_back(*std::move(point));
  }
  return points;
}

}  // namespace tessera
