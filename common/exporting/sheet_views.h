// The views that may show a part of the city.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <span>
#include <vector>

#include "common/scene/scene.h"

namespace tessera {

// Ascending indices of the views whose undistorted image may show a point of `box` (frame of the cameras, metres). No
// view that shows one is missing; occlusion is not tested. None for an empty box.
std::vector<int32_t> ViewsOfBox(std::span<const SceneView> views, const Eigen::AlignedBox3d& box);

}  // namespace tessera
