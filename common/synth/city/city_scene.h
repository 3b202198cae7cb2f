// A part of the city prepared for ray casting: surface, textures, acceleration structure.
#pragma once

#include <memory>
#include <vector>

#include "common/geometry/ray_caster.h"
#include "common/synth/city/plan.h"
#include "common/synth/city/surface.h"
#include "common/synth/city/terrain_grid.h"

namespace tessera {

// Blocks [column_low, column_high) x [row_low, row_high).
struct BlockRange {
  int column_low = 0, column_high = 1;
  int row_low = 0, row_high = 1;
  bool Contains(int column, int row) const {
    return column >= column_low && column < column_high && row >= row_low && row < row_high;
  }
  // The range extended by `margin` blocks on each side, clipped to the city.
  BlockRange Grown(const CityPlan& plan, int margin) const;
};

// Immutable; const functions are thread-safe.
class CityScene {
 public:
  CityScene(const CityPlan& plan, const GroundGrid& grid, const BlockRange& range);

  const CityPlan& plan() const { return plan_; }
  const TexturedSurface& surface() const { return surface_; }
  const RayCaster& caster() const { return *caster_; }
  // Unit vector towards the sun.
  const Eigen::Vector3d& sun() const { return sun_; }

  // Radiance (linear RGB) at the hit point origin + hit.distance·direction: albedo times light of sun and sky.
  Eigen::Vector3f Radiance(const RayHit& hit, const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const;

 private:
  CityPlan plan_;
  TexturedSurface surface_;
  std::vector<Eigen::Vector3f> normals_;
  std::unique_ptr<RayCaster> caster_;
  Eigen::Vector3d sun_;
};

}  // namespace tessera
