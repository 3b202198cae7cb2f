#include "common/exporting/raster/raster_pixels.h"

#include <algorithm>
#include <array>
#include <span>

namespace tessera {
namespace {

// Calls `set(out, inputs)` for each pixel of `half` with the indices of its pixels in `pixels`, ascending.
template <class Set>
void ForEachHalfPixel(const RasterPixels& pixels, const RasterPixels& half, const Set& set) {
  for (int row = 0; row < half.height; ++row) {
    for (int column = 0; column < half.width; ++column) {
      std::array<size_t, 4> inputs;
      size_t count = 0;
      for (int y = 2 * row; y < std::min(2 * row + 2, pixels.height); ++y) {
        for (int x = 2 * column; x < std::min(2 * column + 2, pixels.width); ++x) {
          inputs[count++] = static_cast<size_t>(y) * pixels.width + x;
        }
      }
      set(static_cast<size_t>(row) * half.width + column, std::span<const size_t>(inputs.data(), count));
    }
  }
}

}  // namespace

bool RasterPixels::HasData() const {
  switch (content) {
    case RasterContent::kHeights:
      return std::any_of(heights.begin(), heights.end(), [](float h) { return h != kNoHeight; });
    case RasterContent::kClasses:
      return std::any_of(bytes.begin(), bytes.end(), [](uint8_t c) { return c != kNoClass; });
    case RasterContent::kColors:
      break;
  }
  for (size_t alpha = 3; alpha < bytes.size(); alpha += 4) {
    if (bytes[alpha] != 0) return true;
  }
  return false;
}

RasterPixels EmptyRaster(RasterContent content, int width, int height) {
  RasterPixels pixels;
  pixels.content = content;
  pixels.width = width;
  pixels.height = height;
  const size_t count = static_cast<size_t>(width) * height;
  if (content == RasterContent::kHeights) pixels.heights.assign(count, kNoHeight);
  if (content == RasterContent::kClasses) pixels.bytes.assign(count, kNoClass);
  if (content == RasterContent::kColors) pixels.bytes.assign(4 * count, 0);
  return pixels;
}

RasterPixels HalfRaster(const RasterPixels& pixels) {
  RasterPixels half = EmptyRaster(pixels.content, (pixels.width + 1) / 2, (pixels.height + 1) / 2);
  const auto mean_height = [&](size_t out, std::span<const size_t> inputs) {
    double sum = 0;
    int count = 0;
    for (const size_t in : inputs) {
      if (pixels.heights[in] == kNoHeight) continue;
      sum += pixels.heights[in];
      ++count;
    }
    if (count > 0) half.heights[out] = static_cast<float>(sum / count);
  };
  const auto mode = [&](size_t out, std::span<const size_t> inputs) {
    std::array<int, 256> count = {};
    for (const size_t in : inputs) ++count[pixels.bytes[in]];
    count[kNoClass] = 0;
    const auto most = std::max_element(count.begin(), count.end());
    if (*most > 0) half.bytes[out] = static_cast<uint8_t>(most - count.begin());
  };
  const auto mean_color = [&](size_t out, std::span<const size_t> inputs) {
    std::array<int, 3> sum = {};
    int count = 0;
    for (const size_t in : inputs) {
      if (pixels.bytes[4 * in + 3] == 0) continue;
      for (int k = 0; k < 3; ++k) sum[k] += pixels.bytes[4 * in + k];
      ++count;
    }
    if (count == 0) return;
    for (int k = 0; k < 3; ++k) half.bytes[4 * out + k] = static_cast<uint8_t>((sum[k] + count / 2) / count);
    half.bytes[4 * out + 3] = 255;
  };
  switch (pixels.content) {
    case RasterContent::kHeights:
      ForEachHalfPixel(pixels, half, mean_height);
      break;
    case RasterContent::kClasses:
      ForEachHalfPixel(pixels, half, mode);
      break;
    case RasterContent::kColors:
      ForEachHalfPixel(pixels, half, mean_color);
      break;
  }
  return half;
}

}  // namespace tessera
