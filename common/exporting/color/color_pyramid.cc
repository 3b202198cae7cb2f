#include "common/exporting/color/color_pyramid.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/base/parallel.h"

namespace tessera {

StatusOr<ColorPyramid> ColorPyramid::Read(const std::string& path, const LensModel& lens, const ImagePart& part,
                                          int highest_level, const PhotographOptions& options) {
  // Bilinear interpolation reads the pixels around a position, so that a pixel of the highest level is added.
  const int side = 1 << highest_level;
  const auto low = [&](int at) { return std::max(at / side - 1, 0) * side; };
  const auto high = [&](int at, int size) { return std::min((at / side + 2) * side, size); };
  const ImagePart larger = {low(part.x0), low(part.y0), high(part.x1, lens.pinhole.width),
                            high(part.y1, lens.pinhole.height)};
  ColorPyramid pyramid;
  Level& first = pyramid.levels_.emplace_back();
  TESSERA_ASSIGN_OR_RETURN(first.pixels, ReadColorPart(path, lens, larger, options));
  first.x0 = larger.x0;
  first.y0 = larger.y0;
  first.whole_width = lens.pinhole.width;
  first.whole_height = lens.pinhole.height;
  while (static_cast<int>(pyramid.levels_.size()) <= highest_level) {
    pyramid.levels_.push_back(Halved(pyramid.levels_.back()));
  }
  return pyramid;
}

ColorPyramid::Level ColorPyramid::Halved(const Level& level) {
  const FloatImage& in = level.pixels;
  Level half;
  half.pixels = FloatImage((in.width + 1) / 2, (in.height + 1) / 2, in.channels);
  half.x0 = level.x0 / 2;
  half.y0 = level.y0 / 2;
  half.whole_width = (level.whole_width + 1) / 2;
  half.whole_height = (level.whole_height + 1) / 2;
  ParallelForEach(half.pixels.height, 16, [&](int y) {
    const int y1 = std::min(2 * y + 1, in.height - 1);
    for (int c = 0; c < in.channels; ++c) {
      for (int x = 0; x < half.pixels.width; ++x) {
        const int x1 = std::min(2 * x + 1, in.width - 1);
        half.pixels.at(x, y, c) =
            0.25f * (in.at(2 * x, 2 * y, c) + in.at(x1, 2 * y, c) + in.at(2 * x, y1, c) + in.at(x1, y1, c));
      }
    }
  });
  return half;
}

Eigen::Vector3f ColorPyramid::At(double x, double y, int level) const {
  const Level& from = levels_[level];
  const double scale = std::ldexp(1.0, -level);
  const auto clamped = [](double at, int whole) { return std::clamp(at, 0.0, whole - 1.0); };
  const double u = clamped(x * scale - 0.5, from.whole_width), v = clamped(y * scale - 0.5, from.whole_height);
  const int left = static_cast<int>(u), top = static_cast<int>(v);
  const auto a = static_cast<float>(u - left), b = static_cast<float>(v - top);
  const int u0 = left - from.x0, u1 = std::min(left + 1, from.whole_width - 1) - from.x0;
  const int v0 = top - from.y0, v1 = std::min(top + 1, from.whole_height - 1) - from.y0;
  Eigen::Vector3f color;
  for (int c = 0; c < 3; ++c) {
    const float upper = (1 - a) * from.pixels.at(u0, v0, c) + a * from.pixels.at(u1, v0, c);
    const float lower = (1 - a) * from.pixels.at(u0, v1, c) + a * from.pixels.at(u1, v1, c);
    color[c] = (1 - b) * upper + b * lower;
  }
  return color;
}

}  // namespace tessera
