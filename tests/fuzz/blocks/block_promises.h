// Invariants of blocks that readers accept.
#pragma once

#include <Eigen/LU>
#include <cmath>

#include "common/blocks/block.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// Aborts unless indices are valid, numbers finite, rotations orthonormal, and readings applicable.
inline void RequireBlock(const ImportedBlock& block) {
  const auto require = [](bool condition) { Require(condition, "a block that is taken is valid"); };
  for (const BlockCamera& camera : block.cameras) {
    const PinholeCamera& p = camera.lens.pinhole;
    require(p.width > 0 && p.height > 0 && p.fx > 0 && p.fy > 0 && std::isfinite(p.fx) && std::isfinite(p.fy));
    require(std::isfinite(p.cx) && std::isfinite(p.cy));
    for (const double c : camera.lens.coefficients) require(std::isfinite(c));
  }
  for (const BlockImage& image : block.images) {
    require(!image.path.empty() && image.camera < static_cast<int>(block.cameras.size()));
    if (!image.oriented) continue;
    const Eigen::Matrix3d& r = image.rotation_cam_from_block;
    require(image.camera >= 0 && image.centre.allFinite() && r.determinant() > 0);
    require((r * r.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-9);
  }
  for (const auto* points : {&block.points, &block.control_points}) {
    for (const BlockTiePoint& point : *points) {
      require(point.position.allFinite() && !point.observations.empty());
      for (const BlockObservation& seen : point.observations) {
        require(seen.image >= 0 && seen.image < static_cast<int>(block.images.size()));
        require(seen.position_px.allFinite());
      }
    }
  }
  require(block.offset.allFinite());
  for (const BlockReading& reading : block.readings) {
    ImportedBlock other = block;
    reading.apply(&other);
    require(other.images.size() == block.images.size());
  }
}

}  // namespace tessera
