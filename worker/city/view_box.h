// Tests whether a view can show any part of a box.
#pragma once

#include <Eigen/Geometry>

#include "common/imaging/camera.h"

namespace tessera {

// Conservative: false only if no point of the box projects into the camera's image. Camera and box in the same frame.
inline bool MayShow(const PosedCamera& camera, const Eigen::AlignedBox3d& box) {
  int behind = 0;
  Eigen::AlignedBox2d seen;
  for (int k = 0; k < 8; ++k) {
    const Eigen::Vector3d p = camera.Project(box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(k)));
    if (p.z() <= 0) {
      ++behind;
    } else {
      seen.extend(p.head<2>());
    }
  }
  if (behind > 0) return behind < 8;
  // One pixel of margin for rounding.
  return seen.max().x() >= -1 && seen.max().y() >= -1 && seen.min().x() <= camera.intrinsics.width + 1 &&
         seen.min().y() <= camera.intrinsics.height + 1;
}

}  // namespace tessera
