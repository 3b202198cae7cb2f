#include "worker/refine/texels.h"

#include <cassert>
#include <cmath>

namespace tessera {
namespace {

// Two neighbouring pixels of a line and their weights.
struct Tap {
  int low = 0, high = 0;
  float weight_low = 0, weight_high = 0;
};

// Taps that average an image line over the footprint of each of `count` pixels, `per_pixel` taps each.
struct LineTaps {
  int per_pixel = 1;
  std::vector<Tap> taps;

  // `size` pixels of the other line are at hand, the first of them its pixel `origin`.
  LineTaps(int first, int count, double scale, double offset, int origin, int size) {
    per_pixel = std::max(1, static_cast<int>(std::lround(scale)));
    const float share = 1 / static_cast<float>(per_pixel);
    for (int i = first; i < first + count; ++i) {
      for (int k = 0; k < per_pixel; ++k) {
        const double at = scale * (i + (k + 0.5) / per_pixel) + offset - 0.5;
        const double clamped = std::clamp(at, static_cast<double>(origin), static_cast<double>(origin + size - 1));
        const int low = static_cast<int>(clamped);
        const float high = static_cast<float>(clamped - low);
        taps.push_back({low - origin, std::min(low - origin + 1, size - 1), share * (1 - high), share * high});
      }
    }
  }
  const Tap* of(int i) const { return &taps[static_cast<size_t>(i) * per_pixel]; }
};

void PackClass(const FloatImage& likelihoods, int l, const LineTaps& columns, const LineTaps& rows, Texels* out) {
  const float* plane = likelihoods.plane(l);
  const int shift = 8 * (l % Texels::kClassesPerPlane);
  LineVector<uint32_t>& packed = out->likelihoods[l / Texels::kClassesPerPlane];
  std::vector<float> line(likelihoods.width);
  for (int y = 0; y < out->height; ++y) {
    std::fill(line.begin(), line.end(), 0.0f);
    for (int k = 0; k < rows.per_pixel; ++k) {
      const Tap& tap = rows.of(y)[k];
      const float* low = plane + static_cast<size_t>(tap.low) * likelihoods.width;
      const float* high = plane + static_cast<size_t>(tap.high) * likelihoods.width;
      for (int x = 0; x < likelihoods.width; ++x) line[x] += tap.weight_low * low[x] + tap.weight_high * high[x];
    }
    uint32_t* row = &packed[out->Index(0, y)];
    for (int x = 0; x < out->width; ++x) {
      float sum = 0;
      for (int k = 0; k < columns.per_pixel; ++k) {
        const Tap& tap = columns.of(x)[k];
        sum += tap.weight_low * line[tap.low] + tap.weight_high * line[tap.high];
      }
      const float steps = std::clamp(sum, 0.0f, 1.0f) * Texels::kLikelihoodSteps;
      row[x] |= static_cast<uint32_t>(steps + 0.5f) << shift;
    }
  }
}

}  // namespace

uint16_t LuminanceCode(float luminance) {
  if (std::isnan(luminance)) return 0;
  return static_cast<uint16_t>(1.5f + std::clamp(luminance, 0.0f, 1.0f) * Texels::kLuminanceSteps);
}

Texels MakeTexels(const FloatImage& luminance, int x0, int y0) {
  assert(x0 % 2 == 0 && y0 % 2 == 0);
  Texels out;
  out.x0 = x0;
  out.y0 = y0;
  out.width = luminance.width;
  out.height = luminance.height;
  out.stride = PaddedStride(luminance.width);
  // A spare row, since a cell of bilinear interpolation reads two.
  out.luminance.assign(static_cast<size_t>(out.stride) * (out.height + 1), 0);
  for (int y = 0; y < out.height; ++y) {
    const float* in = luminance.data.data() + static_cast<size_t>(y) * luminance.width;
    uint16_t* row = &out.luminance[out.Index(0, y)];
    for (int x = 0; x < out.width; ++x) row[x] = LuminanceCode(in[x]);
  }
  return out;
}

Texels MakeTexels(const FloatImage& luminance, const FloatImage& likelihoods, const PixelMapping& mapping, int x0,
                  int y0) {
  Texels out = MakeTexels(luminance, x0, y0);
  if (likelihoods.empty()) return out;
  out.classes = likelihoods.channels;
  const int planes = (out.classes + Texels::kClassesPerPlane - 1) / Texels::kClassesPerPlane;
  out.likelihoods.assign(planes, LineVector<uint32_t>(out.luminance.size(), 0));
  const LineTaps columns(x0, out.width, mapping.scale_x, mapping.offset_x, mapping.first_x, likelihoods.width);
  const LineTaps rows(y0, out.height, mapping.scale_y, mapping.offset_y, mapping.first_y, likelihoods.height);
  for (int l = 0; l < out.classes; ++l) PackClass(likelihoods, l, columns, rows, &out);
  return out;
}

PixelMapping ScaleToSize(const FloatImage& luminance, const FloatImage& likelihoods) {
  PixelMapping mapping;
  mapping.scale_x = static_cast<double>(likelihoods.width) / std::max(luminance.width, 1);
  mapping.scale_y = static_cast<double>(likelihoods.height) / std::max(luminance.height, 1);
  return mapping;
}

}  // namespace tessera
