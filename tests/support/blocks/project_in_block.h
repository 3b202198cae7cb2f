// Projection into photographs of a block, apart from the code of the readers and of the proof.
#pragma once

#include "common/blocks/block.h"

namespace tessera {

// The position before distortion, pixels; and the depth in front of the camera.
struct IdealPosition {
  Eigen::Vector2d pixel;
  double depth;
};

inline IdealPosition IdealInBlock(const ImportedBlock& block, const BlockImage& image, const Eigen::Vector3d& point) {
  const PinholeCamera& pinhole = block.cameras[image.camera].lens.pinhole;
  const Eigen::Vector3d x = image.rotation_cam_from_block * (point - image.centre);
  return {{pinhole.fx * x.x() / x.z() + pinhole.cx, pinhole.fy * x.y() / x.z() + pinhole.cy}, x.z()};
}

// Where `point` appears in an image of the block.
inline Eigen::Vector2d ProjectInBlock(const ImportedBlock& block, const BlockImage& image,
                                      const Eigen::Vector3d& point) {
  return block.cameras[image.camera].lens.Distort(IdealInBlock(block, image, point).pixel);
}

}  // namespace tessera
