#include "worker/visibility/face_depths.h"

#include <algorithm>
#include <cmath>

namespace tessera {

using Eigen::Vector3d;

void FaceDepths::UpdateRows(int row_first, int row_last, int width, const int32_t* face, float* depth) const {
  constexpr double kExact = 1 << 25;  // sums of products of such numbers are exact
  for (int y = row_first; y < row_last; ++y) {
    const int32_t* ids = face + static_cast<size_t>(y) * width;
    float* depths = depth + static_cast<size_t>(y) * width;
    const double yc = static_cast<double>((int64_t{y} << kGridBits) + kGridHalf);
    for (int x = 0; x < width; ++x) {
      if (ids[x] < 0) continue;
      const uint32_t f = static_cast<uint32_t>(ids[x]);
      const Triangle& corners = mesh_.faces[f];
      const GridVertex& a = vertices_[corners[0]];
      const GridVertex& b = vertices_[corners[1]];
      const GridVertex& c = vertices_[corners[2]];
      const double xc = static_cast<double>((int64_t{x} << kGridBits) + kGridHalf);
      const double ax = a.x - xc, ay = a.y - yc, bx = b.x - xc, by = b.y - yc, cx = c.x - xc, cy = c.y - yc;
      const double extent =
          std::max({std::abs(ax), std::abs(ay), std::abs(bx), std::abs(by), std::abs(cx), std::abs(cy)});
      if (extent >= kExact || (a.off_grid | b.off_grid | c.off_grid) != 0) {
        depths[x] = UnboundedDepth(f, x, y, depths[x]);
        continue;
      }
      const double area_a = bx * cy - by * cx, area_b = cx * ay - cy * ax, area_c = ax * by - ay * bx;
      const double total = area_a + area_b + area_c;
      const float low = std::min({a.inverse_z, b.inverse_z, c.inverse_z});
      const float high = std::max({a.inverse_z, b.inverse_z, c.inverse_z});
      if (total == 0) {
        depths[x] = std::clamp(depths[x], 1 / high, 1 / low);
        continue;
      }
      depths[x] = 1 / DepthPlane(a.inverse_z, b.inverse_z, c.inverse_z, total).At(area_b, area_c);
    }
  }
}

float FaceDepths::UnboundedDepth(uint32_t f, int x, int y, float old) const {
  const PinholeCamera& k = camera_.intrinsics;
  const Vector3d a = camera_.CameraFromWorld(mesh_.Corner(f, 0)), b = camera_.CameraFromWorld(mesh_.Corner(f, 1)),
                 c = camera_.CameraFromWorld(mesh_.Corner(f, 2));
  const Vector3d normal = (b - a).cross(c - a), ray((x + 0.5 - k.cx) / k.fx, (y + 0.5 - k.cy) / k.fy, 1);
  const double z = normal.dot(a) / normal.dot(ray);
  if (!(z > 0) || !std::isfinite(z)) return old;
  return static_cast<float>(std::clamp(z, std::min({a.z(), b.z(), c.z()}), std::max({a.z(), b.z(), c.z()})));
}

}  // namespace tessera
