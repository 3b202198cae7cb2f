// Invariants of blocks that readers accept.
#pragma once

#include <Eigen/LU>
#include <cmath>

#include "common/blocks/block.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// Aborts unless indices are valid, numbers finite and rotations orthonormal.
inline void RequireBlock(const ImportedBlock& block, const char* promise) {
  for (const BlockCamera& camera : block.cameras) {
    const PinholeCamera& p = camera.lens.pinhole;
    Require(p.width > 0 && p.height > 0 && p.fx > 0 && p.fy > 0, promise);
    Require(std::isfinite(p.fx) && std::isfinite(p.fy) && std::isfinite(p.cx) && std::isfinite(p.cy), promise);
    for (const double c : camera.lens.coefficients) Require(std::isfinite(c), promise);
  }
  for (const BlockImage& image : block.images) {
    Require(!image.path.empty(), promise);
    Require(image.camera >= 0 && image.camera < static_cast<int>(block.cameras.size()), promise);
    const Eigen::Matrix3d& r = image.rotation_cam_from_block;
    Require((r * r.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-9, promise);
    Require(r.determinant() > 0 && image.centre.allFinite(), promise);
  }
  for (const BlockTiePoint& point : block.points) {
    Require(point.position.allFinite(), promise);
    for (const BlockObservation& o : point.observations) {
      Require(o.image >= 0 && o.image < static_cast<int>(block.images.size()), promise);
      Require(o.position_px.allFinite(), promise);
    }
  }
}

}  // namespace tessera
