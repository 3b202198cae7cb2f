// The grid that positions enter the local frame on.
#ifndef TESSERA_WORKER_CITY_LOCAL_GRID_H_
#define TESSERA_WORKER_CITY_LOCAL_GRID_H_

#include <Eigen/Core>

#include "common/imaging/camera.h"

namespace tessera {

// Pitch of the grid, metres: about a micrometre, far below what any scene knows, far above what a double loses at the
// distance of the Earth's centre. A power of two, so that positions on it are exact.
inline constexpr double kLocalGrid_m = 0x1p-20;

// The position of the grid nearest to `p_in_local`. A scene that was moved by a multiple of 1,024 m loses its last bits
// on the way into the local frame; on the grid it has the same bits as before, and so has all that is computed from it.
inline Eigen::Vector3d OnLocalGrid(const Eigen::Vector3d& p_in_local) {
  return (p_in_local / kLocalGrid_m).array().round() * kLocalGrid_m;
}

// The camera with its centre on the grid; its rotation stays.
inline PosedCamera OnLocalGrid(PosedCamera camera) {
  camera.translation_cam_from_world = -(camera.rotation_cam_from_world * OnLocalGrid(camera.Centre()));
  return camera;
}

}  // namespace tessera

#endif  // TESSERA_WORKER_CITY_LOCAL_GRID_H_
