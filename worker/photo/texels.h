// Pixel format of the data term's kernel: quantised, packed luminance and class likelihoods of one view at one
// pyramid level. These quantised values define the image everywhere, including in finite difference tests.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <new>
#include <vector>

namespace tessera {

// Allocates at cache line boundaries, so that vectors of any instruction set do not straddle them.
template <class T>
struct LineAllocator {
  using value_type = T;
  static constexpr std::align_val_t kLine{64};
  LineAllocator() = default;
  template <class U>
  LineAllocator(const LineAllocator<U>&) {}
  T* allocate(size_t n) { return static_cast<T*>(::operator new(n * sizeof(T), kLine)); }
  void deallocate(T* p, size_t) { ::operator delete(p, kLine); }
  bool operator==(const LineAllocator&) const { return true; }
};
template <class T>
using LineVector = std::vector<T, LineAllocator<T>>;

// All pixel loops advance by blocks of this size, for every instruction set.
inline constexpr int kPixelBlock = 16;

// Row stride that holds `width` pixels in whole blocks plus a spare one. An odd number of blocks, so that a column
// does not map to few cache sets.
inline int PaddedStride(int width) {
  const int blocks = (width + kPixelBlock - 1) / kPixelBlock + 1;
  return (blocks | 1) * kPixelBlock;
}

// Float rows [first_row, first_row + rows) of an image, each padded to whole blocks.
struct PaddedPlane {
  int width = 0, first_row = 0, rows = 0, stride = 0;
  LineVector<float> data;

  // Contents are unspecified afterwards, except that a new plane is zero.
  void Reset(int new_width, int new_first_row, int new_rows) {
    width = new_width;
    first_row = new_first_row;
    rows = new_rows;
    stride = PaddedStride(width);
    data.resize(static_cast<size_t>(stride) * rows);
  }
  float* row(int y) { return data.data() + static_cast<ptrdiff_t>(stride) * (y - first_row); }
  const float* row(int y) const { return data.data() + static_cast<ptrdiff_t>(stride) * (y - first_row); }
  void Clear() { std::fill(data.begin(), data.end(), 0.0f); }
};

// Row y of a plane begins at y·stride. Padding, and a spare row at the end, are zero.
struct Texels {
  static constexpr int kClassesPerPlane = 4;
  static constexpr float kLuminanceSteps = 65534;
  static constexpr float kLikelihoodSteps = 255;

  int width = 0, height = 0, stride = 0;
  // Position of the first pixel in the whole image of this level. Even: the kernel finds bilinear cells by rounding
  // to even, and the first pixel's centre must not be assigned to the previous cell.
  int x0 = 0, y0 = 0;
  LineVector<uint16_t> luminance;  // 0: invalid; else 1 + luminance · kLuminanceSteps, luminance in [0, 1]
  int classes = 0;                 // 0: no likelihoods
  // Plane p holds classes 4p .. 4p + 3 of a pixel in bytes 0..3 (lowest first), each likelihood · kLikelihoodSteps.
  std::vector<LineVector<uint32_t>> likelihoods;

  size_t Index(int x, int y) const { return static_cast<size_t>(y) * stride + x; }
  bool Valid(int x, int y) const { return luminance[Index(x, y)] != 0; }
  double Luminance(int x, int y) const { return (luminance[Index(x, y)] - 1.0) / kLuminanceSteps; }
  // Copies `new_width` x `new_height` of these pixels, from pixel (left, top) of the whole image on (both even), to
  // `out`, whose arrays are reused.
  void CropTo(int left, int top, int new_width, int new_height, Texels* out) const;
  double Likelihood(int x, int y, int l) const {
    const uint32_t packed = likelihoods[l / kClassesPerPlane][Index(x, y)];
    return static_cast<double>(packed >> (8 * (l % kClassesPerPlane)) & 255) / kLikelihoodSteps;
  }
};

// Code of Texels::luminance: the value clamped to [0, 1], or NaN for invalid.
inline uint16_t LuminanceCode(float luminance) {
  if (std::isnan(luminance)) return 0;
  return static_cast<uint16_t>(1.5f + std::clamp(luminance, 0.0f, 1.0f) * Texels::kLuminanceSteps);
}
// The likelihood clamped to [0, 1] · Texels::kLikelihoodSteps.
inline uint8_t LikelihoodStep(float likelihood) {
  return static_cast<uint8_t>(std::clamp(likelihood, 0.0f, 1.0f) * Texels::kLikelihoodSteps + 0.5f);
}
// Of many values; vectorised.
std::vector<uint16_t> LuminanceCodes(const std::vector<float>& luminance);
std::vector<uint8_t> LikelihoodStepsOf(const std::vector<float>& likelihoods);

}  // namespace tessera
