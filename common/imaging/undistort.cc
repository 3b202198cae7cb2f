#include "common/imaging/undistort.h"

#include <algorithm>
#include <climits>
#include <cmath>
#include <utility>
#include <vector>

#include "common/base/parallel.h"

namespace tessera {
namespace {

// The largest squared normalised radius up to which the radial polynomial grows. Polynomials are fitted inside the
// image only; beyond it they may decrease, so that the undistorted image would repeat the inside of the photograph.
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

// Calls visit(x, y, p) for the pixels of rows [y0, y1) of `part` that lie inside the photograph. p is the sampling
// position in the distorted image, in pixel indices (pixel coordinates minus 0.5), clamped to the image.
template <class Visit>
void ForEachSampledPixel(const LensModel& lens, double r2_end, const ImagePart& part, int y0, int y1,
                         const Visit& visit) {
  const int width = lens.pinhole.width, height = lens.pinhole.height;
  for (int y = y0; y < y1; ++y) {
    for (int x = part.x0; x < part.x1; ++x) {
      const double u = (x + 0.5 - lens.pinhole.cx) / lens.pinhole.fx;
      const double v = (y + 0.5 - lens.pinhole.cy) / lens.pinhole.fy;
      if (u * u + v * v > r2_end) continue;
      const Eigen::Vector2d p = lens.Distort({x + 0.5, y + 0.5});
      if (!(p.x() >= 0 && p.y() >= 0 && p.x() <= width && p.y() <= height)) continue;
      visit(x, y,
            Eigen::Vector2d(std::clamp(p.x() - 0.5, 0.0, width - 1.0), std::clamp(p.y() - 0.5, 0.0, height - 1.0)));
    }
  }
}

}  // namespace

ImagePart SourcePart(const LensModel& lens, const ImagePart& part) {
  if (lens.kind == LensModel::Kind::kPinhole) return part;
  const double r2_end = LargestGrowingRadius2(lens);
  std::vector<ImagePart> rows(std::max(part.height(), 0), {INT_MAX, INT_MAX, 0, 0});
  ParallelForEach(part.height(), 16, [&](int64_t i) {
    ImagePart& row = rows[i];
    const int y = part.y0 + static_cast<int>(i);
    ForEachSampledPixel(lens, r2_end, part, y, y + 1, [&](int, int, const Eigen::Vector2d& p) {
      const int x0 = static_cast<int>(p.x()), y0 = static_cast<int>(p.y());
      row = {std::min(row.x0, x0), std::min(row.y0, y0), std::max(row.x1, x0), std::max(row.y1, y0)};
    });
  });
  ImagePart all = {INT_MAX, INT_MAX, 0, 0};
  for (const ImagePart& row : rows) {
    all = {std::min(all.x0, row.x0), std::min(all.y0, row.y0), std::max(all.x1, row.x1), std::max(all.y1, row.y1)};
  }
  if (all.x0 == INT_MAX) return {0, 0, std::min(1, lens.pinhole.width), std::min(1, lens.pinhole.height)};
  // Bilinear sampling reads pixels x and x + 1, or x - 1 and x at the image border.
  return {std::max(all.x0 - 1, 0), std::max(all.y0 - 1, 0), std::min(all.x1 + 2, lens.pinhole.width),
          std::min(all.y1 + 2, lens.pinhole.height)};
}

// All positions are computed in the coordinates of the whole image and only then shifted into the part, so that a part
// is bit-identical to the same part of the whole image.
FloatImage UndistortPart(FloatImage source, const ImagePart& source_part, const LensModel& lens, const ImagePart& part,
                         float outside) {
  if (lens.kind == LensModel::Kind::kPinhole && source_part == part) return source;
  const int width = lens.pinhole.width, height = lens.pinhole.height;
  FloatImage image(part.width(), part.height(), source.channels, outside);
  const double r2_end = LargestGrowingRadius2(lens);
  ParallelFor(part.height(), 16, [&](int64_t begin, int64_t end) {
    const int y_begin = part.y0 + static_cast<int>(begin), y_end = part.y0 + static_cast<int>(end);
    ForEachSampledPixel(lens, r2_end, part, y_begin, y_end, [&](int x, int y, const Eigen::Vector2d& p) {
      int x0 = std::min(static_cast<int>(p.x()), std::max(width - 2, 0));
      int y0 = std::min(static_cast<int>(p.y()), std::max(height - 2, 0));
      const float a = static_cast<float>(p.x() - x0), b = static_cast<float>(p.y() - y0);
      const int x1 = std::min(x0 + 1, width - 1) - source_part.x0, y1 = std::min(y0 + 1, height - 1) - source_part.y0;
      x0 -= source_part.x0;
      y0 -= source_part.y0;
      for (int c = 0; c < source.channels; ++c) {
        const float top = (1 - a) * source.at(x0, y0, c) + a * source.at(x1, y0, c);
        const float bottom = (1 - a) * source.at(x0, y1, c) + a * source.at(x1, y1, c);
        image.at(x - part.x0, y - part.y0, c) = (1 - b) * top + b * bottom;
      }
    });
  });
  return image;
}

}  // namespace tessera
