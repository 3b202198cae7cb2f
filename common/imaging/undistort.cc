#include "common/imaging/undistort.h"

#include <algorithm>
#include <cmath>

#include "common/base/parallel.h"

namespace tessera {
namespace {

// Largest squared normalised radius up to which the radial polynomial grows: further out, polynomials fitted to the
// image alone fold back and would show its inside again.
double LargestGrowingRadius2(const LensModel& lens) {
  LensModel radial = lens;
  radial.coefficients[2] = radial.coefficients[3] = 0;
  radial.pinhole.cx = radial.pinhole.cy = 0;
  radial.pinhole.fx = radial.pinhole.fy = 1;
  const PinholeCamera& camera = lens.pinhole;
  const double u = std::max(std::abs(camera.cx), std::abs(camera.width - camera.cx)) / camera.fx;
  const double v = std::max(std::abs(camera.cy), std::abs(camera.height - camera.cy)) / camera.fy;
  const double end = 1.01 * std::hypot(u, v);
  constexpr int kSteps = 4096;
  double previous = 0;
  for (int i = 1; i <= kSteps; ++i) {
    const double r = end * i / kSteps, distorted = radial.Distort({r, 0}).x();
    if (!(distorted > previous)) return std::pow(end * (i - 1) / kSteps, 2);
    previous = distorted;
  }
  return end * end;
}

}  // namespace

FloatImage Undistort(FloatImage distorted, const LensModel& lens, float outside) {
  if (lens.kind == LensModel::Kind::kPinhole) return distorted;
  const int width = distorted.width, height = distorted.height;
  FloatImage image(width, height, distorted.channels, outside);
  const double r2_end = LargestGrowingRadius2(lens);
  ParallelFor(height, 16, [&](int64_t begin, int64_t end) {
    for (int y = static_cast<int>(begin); y < end; ++y) {
      for (int x = 0; x < width; ++x) {
        const double u = (x + 0.5 - lens.pinhole.cx) / lens.pinhole.fx;
        const double v = (y + 0.5 - lens.pinhole.cy) / lens.pinhole.fy;
        if (u * u + v * v > r2_end) continue;
        const Eigen::Vector2d p = lens.Distort({x + 0.5, y + 0.5});
        if (!(p.x() >= 0 && p.y() >= 0 && p.x() <= width && p.y() <= height)) continue;
        const double px = std::clamp(p.x() - 0.5, 0.0, width - 1.0), py = std::clamp(p.y() - 0.5, 0.0, height - 1.0);
        const int x0 = std::min(static_cast<int>(px), std::max(width - 2, 0));
        const int y0 = std::min(static_cast<int>(py), std::max(height - 2, 0));
        const int x1 = std::min(x0 + 1, width - 1), y1 = std::min(y0 + 1, height - 1);
        const float a = static_cast<float>(px - x0), b = static_cast<float>(py - y0);
        for (int c = 0; c < distorted.channels; ++c) {
          const float top = (1 - a) * distorted.at(x0, y0, c) + a * distorted.at(x1, y0, c);
          const float bottom = (1 - a) * distorted.at(x0, y1, c) + a * distorted.at(x1, y1, c);
          image.at(x, y, c) = (1 - b) * top + b * bottom;
        }
      }
    }
  });
  return image;
}

}  // namespace tessera
