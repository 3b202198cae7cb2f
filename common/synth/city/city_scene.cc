#include "common/synth/city/city_scene.h"

#include <algorithm>
#include <cmath>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "common/synth/city/texture.h"

namespace tessera {

BlockRange BlockRange::Grown(const CityPlan& plan, int margin) const {
  return {std::max(0, column_low - margin), std::min(plan.columns, column_high + margin), std::max(0, row_low - margin),
          std::min(plan.rows, row_high + margin)};
}

CityScene::CityScene(const CityPlan& plan, const GroundGrid& grid, const BlockRange& range) : plan_(plan) {
  const int columns = range.column_high - range.column_low, rows = range.row_high - range.row_low;
  std::vector<TexturedSurface> parts(static_cast<size_t>(columns) * rows);
  ParallelForEach(parts.size(), 1, [&](size_t k) {
    const int column = range.column_low + static_cast<int>(k) % columns,
              row = range.row_low + static_cast<int>(k) / columns;
    parts[k] = BuildGround(plan, grid, column, row);
    parts[k].Append(BuildBlock(plan, column, row).surface);
  });
  for (const TexturedSurface& part : parts) surface_.Append(part);
  normals_.resize(surface_.mesh.faces.size());
  for (size_t f = 0; f < normals_.size(); ++f) normals_[f] = FaceNormal(surface_.mesh, f).cast<float>();
  caster_ = std::make_unique<RayCaster>(surface_.mesh);
  Random random(plan.seed ^ 0x73756eull);
  const double azimuth = random.Uniform(0, 6.283185307179586), elevation = random.Uniform(0.85, 1.0);
  sun_ = {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth), std::sin(elevation)};
}

Eigen::Vector3f CityScene::Radiance(const RayHit& hit, const Eigen::Vector3d& origin,
                                    const Eigen::Vector3d& direction) const {
  const Eigen::Vector3d p = origin + hit.distance * direction;
  const Eigen::Vector3f normal = normals_[hit.face];
  const float towards_sun = normal.dot(sun_.cast<float>());
  Eigen::Vector3f light = Eigen::Vector3f(0.42f, 0.46f, 0.54f) * (0.6f + 0.4f * normal.z());
  if (towards_sun > 0.02f) {
    const Eigen::Vector3d lifted = p + 0.01 * normal.cast<double>();
    if (!caster_->Occluded(lifted, lifted + 150.0 * sun_, 0.01))
      light += Eigen::Vector3f(0.98f, 0.93f, 0.82f) * towards_sun;
  }
  return Albedo(plan_, surface_.patches[surface_.patch_of_face[hit.face]], p).cwiseProduct(light);
}

}  // namespace tessera
