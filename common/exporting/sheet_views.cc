#include "common/exporting/sheet_views.h"

#include <algorithm>
#include <array>

namespace tessera {
namespace {

// Whether all corners of the box lie on the outer side of one of the five planes that bound what the camera sees.
bool IsOutside(const PosedCamera& camera, const Eigen::AlignedBox3d& box) {
  const PinholeCamera& c = camera.intrinsics;
  std::array<int, 5> outside{};
  for (int k = 0; k < 8; ++k) {
    const Eigen::Vector3d p = camera.CameraFromWorld(box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(k)));
    const double x = c.fx * p.x() + c.cx * p.z(), y = c.fy * p.y() + c.cy * p.z();  // pixels times depth
    outside[0] += p.z() <= 0;
    outside[1] += x < 0;
    outside[2] += x > c.width * p.z();
    outside[3] += y < 0;
    outside[4] += y > c.height * p.z();
  }
  return std::find(outside.begin(), outside.end(), 8) != outside.end();
}

}  // namespace

std::vector<int32_t> ViewsOfBox(std::span<const SceneView> views, const Eigen::AlignedBox3d& box) {
  std::vector<int32_t> found;
  if (box.isEmpty()) return found;
  for (size_t v = 0; v < views.size(); ++v) {
    if (!IsOutside(views[v].camera, box)) found.push_back(static_cast<int32_t>(v));
  }
  return found;
}

}  // namespace tessera
