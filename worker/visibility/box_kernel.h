// Projects boxes into an image. Uses the widest instruction set of the machine and gives the same bytes on each.
#pragma once

#include <Eigen/Geometry>
#include <span>

#include "worker/visibility/image_window.h"

namespace tessera {

// For each box, bounds of the pixels of a window that may show something of it, grown by rounding: empty if it is
// empty or behind the plane `near_m` in front of the camera, the whole window if this plane cuts it.
// `out`: at least as many as boxes.
void BoundPixels(const CameraWindow& view, std::span<const Eigen::AlignedBox3d> boxes, double near_m,
                 std::span<PixelRect> out);

}  // namespace tessera
