#include "worker/label/unary.h"

#include <algorithm>
#include <array>

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

// `value`: of an element of a plane.
template <class T, class Value>
void AddSampled(const FaceMap& map, const T* planes, int width, int height, const PixelMapping& mapping,
                const std::vector<uint8_t>& own, const FaceShares& shares, int share, const Value& value,
                FaceLikelihoods* sums) {
  const int classes = sums->classes;
  const std::vector<Sample> columns =
      SamplesAlong(map.x0, map.width, mapping.scale_x, mapping.offset_x, mapping.first_x, width);
  const std::vector<Sample> rows =
      SamplesAlong(map.y0, map.height, mapping.scale_y, mapping.offset_y, mapping.first_y, height);
  const size_t stride = width, plane = stride * height;
  for (int y = 0; y < map.height; ++y) {
    const Sample& row = rows[y];
    for (int first = 0, run = 0; first < map.width; first += FaceShares::kRun, ++run) {
      if (!shares.InRun(share, y, run)) continue;
      const int end = std::min(first + FaceShares::kRun, map.width);
      for (int x = first; x < end; ++x) {
        const int32_t face = map.face[static_cast<size_t>(y) * map.width + x];
        if (face < 0 || shares.Of(face) != share || (!own.empty() && !own[face])) continue;
        const Sample& column = columns[x];
        sums->pixels[face] += 1;
        float* sum = &sums->sum[static_cast<size_t>(face) * classes];
        for (int l = 0; l < classes; ++l) {
          const T* low = planes + l * plane + row.low * stride;
          const T* high = planes + l * plane + row.high * stride;
          const float above_left = value(low[column.low]), below_left = value(high[column.low]);
          const float above = above_left + column.weight * (value(low[column.high]) - above_left);
          const float below = below_left + column.weight * (value(high[column.high]) - below_left);
          sum[l] += above + row.weight * (below - above);
        }
      }
    }
  }
}

}  // namespace

PixelRect SampledPart(const PixelRect& window, const PixelMapping& mapping, int width, int height) {
  const auto at = [](int pixel, double scale, double offset, int origin, int size) {
    return SampleAt(scale * (pixel + 0.5) + offset, origin, size);
  };
  const PixelMapping& m = mapping;
  return {at(window.x0, m.scale_x, m.offset_x, m.first_x, width).low,
          at(window.y0, m.scale_y, m.offset_y, m.first_y, height).low,
          at(window.x1 - 1, m.scale_x, m.offset_x, m.first_x, width).high + 1,
          at(window.y1 - 1, m.scale_y, m.offset_y, m.first_y, height).high + 1};
}

FaceShares::FaceShares(const FaceMap& map, const std::vector<uint8_t>& own, int count)
    : count_(count), runs_of_row_((map.width + kRun - 1) / kRun) {
  if (count == 1) return;
  runs_.resize(static_cast<size_t>(map.height) * runs_of_row_);
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      const int32_t face = map.face[static_cast<size_t>(y) * map.width + x];
      if (face < 0 || (!own.empty() && !own[face])) continue;
      runs_[static_cast<size_t>(y) * runs_of_row_ + x / kRun] |= uint64_t{1} << Of(face);
    }
  }
}

void AddLikelihoods(const FaceMap& map, const FloatImage& likelihoods, const PixelMapping& mapping,
                    FaceLikelihoods* sums) {
  const auto value = [](float v) { return v; };
  AddSampled(map, likelihoods.plane(0), likelihoods.width, likelihoods.height, mapping, {}, {}, 0, value, sums);
}

void AddLikelihoods(const FaceMap& map, const LikelihoodSteps& likelihoods, const PixelMapping& mapping,
                    const std::vector<uint8_t>& own, FaceLikelihoods* sums, const FaceShares& shares, int share) {
  std::array<float, 256> values;
  for (size_t step = 0; step < values.size(); ++step) values[step] = static_cast<float>(step) / likelihoods.per_unit;
  const auto value = [&](uint8_t step) { return values[step]; };
  AddSampled(map, likelihoods.steps.data(), likelihoods.width, likelihoods.height, mapping, own, shares, share, value,
             sums);
}

}  // namespace tessera
