// What readers promise of the blocks that they return without a fault.
#pragma once

#include <Eigen/LU>
#include <cmath>

#include "common/blocks/block.h"
#include "tests/fuzz/promises.h"

namespace tessera {

inline void RequireReadBlock(const ImportedBlock& block) {
  Require(!block.images.empty(), "a block has images");
  for (const BlockCamera& camera : block.cameras) {
    const PinholeCamera& p = camera.lens.pinhole;
    Require(p.width > 0 && p.height > 0 && p.fx > 0 && p.fy > 0, "cameras have pixels and focal lengths");
    Require(std::isfinite(p.fx) && std::isfinite(p.fy) && std::isfinite(p.cx) && std::isfinite(p.cy),
            "cameras are finite");
    for (const double c : camera.lens.coefficients) Require(std::isfinite(c), "lenses are finite");
  }
  for (const BlockImage& image : block.images) {
    Require(!image.path.empty(), "images have names");
    Require(image.camera >= 0 && image.camera < static_cast<int>(block.cameras.size()), "images have cameras");
    const Eigen::Matrix3d& R = image.rotation_cam_from_block;
    Require((R * R.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-9 && R.determinant() > 0,
            "rotations are rotations");
    Require(image.centre.allFinite(), "centres are finite");
  }
  for (const BlockTiePoint& point : block.points) {
    Require(point.position.allFinite() && point.observations.size() >= 2, "tie points are finite and in two images");
    for (const BlockObservation& o : point.observations) {
      Require(o.image >= 0 && o.image < static_cast<int>(block.images.size()), "observations have images");
      Require(o.position_px.allFinite(), "observations are finite");
    }
  }
  Require(block.offset.allFinite(), "the offset is finite");
}

}  // namespace tessera
