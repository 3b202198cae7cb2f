#include "worker/label/unary.h"

#include <algorithm>

namespace tessera {
namespace {

// The two pixels of a row or column around `position` (centres at +0.5), and the weight of the second.
struct Sample {
  int low = 0, high = 0;
  float weight = 0;
};

// `size` pixels are available; the first is the whole image's pixel `origin`.
Sample SampleAt(double position, int origin, int size) {
  const double clamped =
      std::clamp(position - 0.5, static_cast<double>(origin), static_cast<double>(origin + size - 1));
  Sample sample;
  const int low = static_cast<int>(clamped);
  sample.low = low - origin;
  sample.high = std::min(sample.low + 1, size - 1);
  sample.weight = static_cast<float>(clamped - low);
  return sample;
}

std::vector<Sample> SamplesAlong(int first, int count, double scale, double offset, int origin, int size) {
  std::vector<Sample> samples(count);
  for (int i = 0; i < count; ++i) samples[i] = SampleAt(scale * (first + i + 0.5) + offset, origin, size);
  return samples;
}

}  // namespace

void AddLikelihoods(const FaceMap& map, const FloatImage& likelihoods, const PixelMapping& mapping,
                    FaceLikelihoods* sums) {
  const int classes = sums->classes;
  const std::vector<Sample> columns =
      SamplesAlong(map.x0, map.width, mapping.scale_x, mapping.offset_x, mapping.first_x, likelihoods.width);
  const std::vector<Sample> rows =
      SamplesAlong(map.y0, map.height, mapping.scale_y, mapping.offset_y, mapping.first_y, likelihoods.height);
  const size_t stride = likelihoods.width;
  for (int y = 0; y < map.height; ++y) {
    const Sample& row = rows[y];
    for (int x = 0; x < map.width; ++x) {
      const int32_t face = map.face[static_cast<size_t>(y) * map.width + x];
      if (face < 0) continue;
      const Sample& column = columns[x];
      sums->pixels[face] += 1;
      float* sum = &sums->sum[static_cast<size_t>(face) * classes];
      for (int l = 0; l < classes; ++l) {
        const float* low = likelihoods.plane(l) + row.low * stride;
        const float* high = likelihoods.plane(l) + row.high * stride;
        const float above = low[column.low] + column.weight * (low[column.high] - low[column.low]);
        const float below = high[column.low] + column.weight * (high[column.high] - high[column.low]);
        sum[l] += above + row.weight * (below - above);
      }
    }
  }
}

}  // namespace tessera
