// The grid to which positions are rounded on entry into the local frame.
#pragma once

#include <Eigen/Core>

#include "common/imaging/camera.h"

namespace tessera {

// Grid spacing in metres: about a micrometre, far below any scene's accuracy and far above the rounding error of a
// double at the Earth's radius. A power of two, so that grid positions are exact.
inline constexpr double kLocalGrid_m = 0x1p-20;

// Rounds a local position to the grid. Translating a scene by a multiple of 1,024 m changes the last bits of the
// conversion into the local frame; on the grid the position, and all results computed from it, are the same bits
// again.
inline Eigen::Vector3d OnLocalGrid(const Eigen::Vector3d& p_in_local) {
  return (p_in_local / kLocalGrid_m).array().round() * kLocalGrid_m;
}

// The camera with its centre on the grid and its rotation unchanged.
inline PosedCamera OnLocalGrid(PosedCamera camera) {
  camera.translation_cam_from_world = -(camera.rotation_cam_from_world * OnLocalGrid(camera.Centre()));
  return camera;
}

}  // namespace tessera
