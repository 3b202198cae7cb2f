#include "worker/photo/stored_texels.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>

#include "common/base/loops/uninitialized_vector.h"
#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int64_t kRowGrain = 256;  // rows of a window that a thread loads

// Two adjacent pixels of a line and their weights.
struct Tap {
  int low = 0, high = 0;
  float weight_low = 0, weight_high = 0;
};

// Taps that average an image line over the footprint of each of `count` pixels, `per_pixel` taps each.
struct LineTaps {
  int per_pixel = 1;
  std::vector<Tap> taps;

  LineTaps() = default;
  // `size` pixels of the source line are available; the first is its pixel `origin`.
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

// Resamples class l for rows [row_begin, row_end) of `out`, if the resolutions differ.
void SampleClass(const StoredTexels& from, int l, const LineTaps& columns, const LineTaps& rows, int row_begin,
                 int row_end, Texels* out) {
  const size_t width = from.likelihood_width;
  const uint8_t* plane = from.likelihoods.data() + width * from.likelihood_height * l;
  const int shift = 8 * (l % Texels::kClassesPerPlane);
  LineVector<uint32_t>& packed = out->likelihoods[l / Texels::kClassesPerPlane];
  std::vector<float> line(width);
  for (int y = row_begin; y < row_end; ++y) {
    std::fill(line.begin(), line.end(), 0.0f);
    for (int k = 0; k < rows.per_pixel; ++k) {
      const Tap& tap = rows.of(y)[k];
      const uint8_t *low = plane + tap.low * width, *high = plane + tap.high * width;
      for (size_t x = 0; x < width; ++x) line[x] += tap.weight_low * low[x] + tap.weight_high * high[x];
    }
    uint32_t* row = &packed[out->Index(0, y)];
    for (int x = 0; x < out->width; ++x) {
      float sum = 0;
      for (int k = 0; k < columns.per_pixel; ++k) {
        const Tap& tap = columns.of(x)[k];
        sum += tap.weight_low * line[tap.low] + tap.weight_high * line[tap.high];
      }
      row[x] |= static_cast<uint32_t>(std::min(sum, Texels::kLikelihoodSteps) + 0.5f) << shift;
    }
  }
}

PixelRect Common(const PixelRect& a, const PixelRect& b) {
  const PixelRect both{std::max(a.x0, b.x0), std::max(a.y0, b.y0), std::min(a.x1, b.x1), std::min(a.y1, b.y1)};
  return both.empty() ? PixelRect() : both;
}

// Resizes a plane of `texels`. One spare row: a bilinear cell reads two rows.
template <class T>
void ResizePlane(const Texels& texels, LineVector<T>* plane) {
  plane->resize(static_cast<size_t>(texels.stride) * (texels.height + 1));
}

// Clears everything in rows [row_begin, row_end) outside `inside`, which is within the texels or empty.
template <class T>
void ClearAround(const PixelRect& inside, const Texels& texels, int row_begin, int row_end, LineVector<T>* plane) {
  for (int y = row_begin; y < row_end; ++y) {
    T* row = plane->data() + texels.Index(0, y);
    const bool crosses = y >= inside.y0 - texels.y0 && y < inside.y1 - texels.y0;
    const int begin = crosses ? inside.x0 - texels.x0 : 0, end = crosses ? inside.x1 - texels.x0 : 0;
    std::fill(row, row + begin, T(0));
    std::fill(row + end, row + texels.stride, T(0));
  }
}

// Rows of planes of a level: where they are mapped, or copied from the file in bands that stay in the cache. Not
// thread-safe.
template <class T>
class RowReader {
 public:
  // `planes`: of `width` x `height` values each, one after the other. Rows up to `end` will be read, in ascending
  // order.
  RowReader(const StoredTexels& from, std::span<const T> planes, int width, int height, int end)
      : from_(from), planes_(planes), width_(width), height_(height), end_(end) {}

  // Row y of `count` planes from `first` on, then repeats of the last plane's. Valid until the next call.
  std::array<const T*, Texels::kClassesPerPlane> Rows(size_t first, size_t count, int y) {
    std::array<const T*, Texels::kClassesPerPlane> rows;
    const size_t width = width_, plane = width * height_;
    if (!from_.copy || failed_) {
      rows.fill(planes_.data() + (first + count - 1) * plane + y * width);
      for (size_t l = 0; l < count; ++l) rows[l] = planes_.data() + (first + l) * plane + y * width;
      return rows;
    }
    if (y < band_begin_ || y >= band_end_ || first != band_first_) {
      const auto rows_of_band = std::max<size_t>(1, kBandBytes / std::max<size_t>(1, width * count * sizeof(T)));
      band_first_ = first;
      band_begin_ = y;
      band_end_ = static_cast<int>(std::min<size_t>(end_, y + rows_of_band));
      const size_t values = (band_end_ - band_begin_) * width;
      band_.resize(values * count);
      for (size_t l = 0; l < count && !failed_; ++l) {
        failed_ = !from_.copy(planes_.data() + (first + l) * plane + y * width, values * sizeof(T), &band_[l * values]);
      }
      if (failed_) return Rows(first, count, y);
    }
    const size_t values = (band_end_ - band_begin_) * width;
    rows.fill(&band_[(count - 1) * values + (y - band_begin_) * width]);
    for (size_t l = 0; l < count; ++l) rows[l] = &band_[l * values + (y - band_begin_) * width];
    return rows;
  }

 private:
  static constexpr size_t kBandBytes = size_t{1} << 18;
  const StoredTexels& from_;
  const std::span<const T> planes_;
  const int width_, height_, end_;
  UninitializedVector<T> band_;
  size_t band_first_ = 0;
  int band_begin_ = 0, band_end_ = 0;
  bool failed_ = false;
};

// Packs all classes of the rows of `both`, if the resolutions are equal.
void InterleaveClasses(const StoredTexels& from, const PixelRect& both, Texels* out) {
  RowReader<uint8_t> reader(from, from.likelihoods, from.rect.width(), from.rect.height(), both.y1 - from.rect.y0);
  for (size_t p = 0; p < out->likelihoods.size(); ++p) {
    const size_t first = p * Texels::kClassesPerPlane;
    const size_t classes = std::min<size_t>(Texels::kClassesPerPlane, from.classes - first);
    for (int y = both.y0; y < both.y1; ++y) {
      const auto in = reader.Rows(first, classes, y - from.rect.y0);
      // Bytes may alias anything: without __restrict the loops are not vectorised.
      uint32_t* __restrict row = &out->likelihoods[p][out->Index(both.x0 - out->x0, y - out->y0)];
      const int width = both.width(), left = both.x0 - from.rect.x0;
      const uint8_t *a = in[0] + left, *b = in[1] + left, *c = in[2] + left, *d = in[3] + left;
      const auto shifted = [](uint8_t value, int bits) { return static_cast<uint32_t>(value) << bits; };
      switch (classes) {
        case 4:
          for (int x = 0; x < width; ++x) row[x] = a[x] | shifted(b[x], 8) | shifted(c[x], 16) | shifted(d[x], 24);
          break;
        case 3:
          for (int x = 0; x < width; ++x) row[x] = a[x] | shifted(b[x], 8) | shifted(c[x], 16);
          break;
        case 2:
          for (int x = 0; x < width; ++x) row[x] = a[x] | shifted(b[x], 8);
          break;
        default:
          for (int x = 0; x < width; ++x) row[x] = a[x];
      }
    }
  }
}

// Taps of likelihoods of another resolution.
struct LikelihoodTaps {
  LineTaps columns, rows;
};

// Loads rows [row_begin, row_end) of `texels`, which is of `window`. `available`: the pixels of it that are stored.
void LoadRows(const StoredTexels& from, const PixelRect& window, const PixelRect& available, const LikelihoodTaps& taps,
              int row_begin, int row_end, Texels* texels) {
  const PixelRect rows = {window.x0, window.y0 + row_begin, window.x1, window.y0 + row_end};
  const PixelRect both = Common(available, rows);
  ClearAround(both, *texels, row_begin, row_end, &texels->luminance);
  RowReader<uint16_t> reader(from, from.luminance, from.rect.width(), from.rect.height(), both.y1 - from.rect.y0);
  for (int y = both.y0; y < both.y1; ++y) {
    const uint16_t* in = reader.Rows(0, 1, y - from.rect.y0)[0] + (both.x0 - from.rect.x0);
    std::copy_n(in, both.width(), &texels->luminance[texels->Index(both.x0 - window.x0, y - window.y0)]);
  }
  const PixelRect nothing;
  for (LineVector<uint32_t>& plane : texels->likelihoods) {
    ClearAround(from.same_resolution ? both : nothing, *texels, row_begin, row_end, &plane);
  }
  if (from.classes == 0 || available.empty()) return;
  if (from.same_resolution) {
    if (!both.empty()) InterleaveClasses(from, both, texels);
    return;
  }
  for (int l = 0; l < from.classes; ++l) {
    SampleClass(from, l, taps.columns, taps.rows, row_begin, std::min(row_end, texels->height), texels);
  }
}

}  // namespace

TexelShape TexelShape::First(const PixelRect& rect, int classes, int likelihood_width, int likelihood_height,
                             const PixelMapping& mapping) {
  TexelShape out = {rect, classes, likelihood_width, likelihood_height, mapping};
  out.same_resolution = classes > 0 && mapping.scale_x == 1 && mapping.scale_y == 1 && mapping.offset_x == 0 &&
                        mapping.offset_y == 0 && mapping.first_x == rect.x0 && mapping.first_y == rect.y0 &&
                        likelihood_width == rect.width() && likelihood_height == rect.height();
  return out;
}

TexelShape TexelShape::Half() const {
  TexelShape half = *this;
  // Odd bounds are rounded inwards: only pixels that are completely inside.
  half.rect = {(rect.x0 + 1) >> 1, (rect.y0 + 1) >> 1, rect.x1 >> 1, rect.y1 >> 1};
  if (half.rect.empty()) half.rect = {half.rect.x0, half.rect.y0, half.rect.x0, half.rect.y0};
  if (classes == 0) return half;
  if (same_resolution) {
    half.likelihood_width = half.rect.width();
    half.likelihood_height = half.rect.height();
    half.mapping.first_x = half.rect.x0;
    half.mapping.first_y = half.rect.y0;
  } else {
    half.mapping.scale_x *= 2;
    half.mapping.scale_y *= 2;
  }
  return half;
}

StoredTexels StoredTexels::WithOrigin(int x, int y) const {
  StoredTexels out = *this;
  out.rect = {rect.x0 - x, rect.y0 - y, rect.x1 - x, rect.y1 - y};
  if (same_resolution) {
    out.mapping.first_x -= x;
    out.mapping.first_y -= y;
  } else {
    out.mapping.offset_x += mapping.scale_x * x;
    out.mapping.offset_y += mapping.scale_y * y;
  }
  return out;
}

void StoredTexels::LoadWindow(const PixelRect& window, Texels* texels) const {
  assert(window.x0 % 2 == 0 && window.y0 % 2 == 0);
  texels->x0 = window.x0;
  texels->y0 = window.y0;
  texels->width = window.width();
  texels->height = window.height();
  texels->stride = PaddedStride(texels->width);
  texels->classes = classes;
  ResizePlane(*texels, &texels->luminance);
  texels->likelihoods.resize((classes + Texels::kClassesPerPlane - 1) / Texels::kClassesPerPlane);
  for (LineVector<uint32_t>& plane : texels->likelihoods) ResizePlane(*texels, &plane);
  const PixelRect available = Common(rect, window);
  LikelihoodTaps taps;
  if (classes > 0 && !same_resolution && !available.empty()) {
    taps.columns = LineTaps(window.x0, texels->width, mapping.scale_x, mapping.offset_x, mapping.first_x,
                            likelihood_width);
    taps.rows = LineTaps(window.y0, texels->height, mapping.scale_y, mapping.offset_y, mapping.first_y,
                         likelihood_height);
  }
  // With the spare row.
  ParallelFor(texels->height + 1, kRowGrain, [&](int64_t begin, int64_t end) {
    LoadRows(*this, window, available, taps, static_cast<int>(begin), static_cast<int>(end), texels);
  });
  if (release && (!copy || (classes > 0 && !same_resolution))) release();
}

void Texels::CropTo(int left, int top, int new_width, int new_height, Texels* out) const {
  out->x0 = left;
  out->y0 = top;
  out->width = new_width;
  out->height = new_height;
  out->stride = PaddedStride(new_width);
  out->classes = classes;
  const PixelRect all = {left, top, left + new_width, top + new_height};
  const auto copy = [&](const auto& from, auto* to) {
    ResizePlane(*out, to);
    ParallelFor(new_height + 1, kRowGrain, [&](int64_t begin, int64_t end) {
      ClearAround(all, *out, static_cast<int>(begin), static_cast<int>(end), to);
      for (int y = static_cast<int>(begin); y < std::min<int64_t>(end, new_height); ++y) {
        std::copy_n(&from[Index(left - x0, top - y0 + y)], new_width, &(*to)[out->Index(0, y)]);
      }
    });
  };
  copy(luminance, &out->luminance);
  out->likelihoods.resize(likelihoods.size());
  for (size_t p = 0; p < likelihoods.size(); ++p) copy(likelihoods[p], &out->likelihoods[p]);
}

std::vector<uint16_t> StoredTexels::HalfLuminance() const {
  const TexelShape half = Half();
  std::vector<uint16_t> out(half.pixels());
  const size_t stride = rect.width();
  for (int y = 0; y < half.rect.height(); ++y) {
    const uint16_t* in = luminance.data() + (2 * (half.rect.y0 + y) - rect.y0) * stride + (2 * half.rect.x0 - rect.x0);
    uint16_t* row = out.data() + static_cast<size_t>(y) * half.rect.width();
    for (int x = 0; x < half.rect.width(); ++x) {
      const uint32_t a = in[2 * x], b = in[2 * x + 1], c = in[2 * x + stride], d = in[2 * x + stride + 1];
      row[x] = (a == 0 || b == 0 || c == 0 || d == 0) ? 0 : static_cast<uint16_t>((a + b + c + d + 2) >> 2);
    }
  }
  return out;
}

std::vector<uint8_t> StoredTexels::HalfLikelihoods() const {
  assert(same_resolution);
  const TexelShape half = Half();
  std::vector<uint8_t> out(half.likelihood_values());
  const size_t stride = rect.width();
  uint8_t* row = out.data();
  for (int l = 0; l < classes; ++l) {
    for (int y = 0; y < half.rect.height(); ++y, row += half.rect.width()) {
      const uint8_t* in = likelihoods.data() + l * pixels() + (2 * (half.rect.y0 + y) - rect.y0) * stride +
                          (2 * half.rect.x0 - rect.x0);
      for (int x = 0; x < half.rect.width(); ++x) {
        row[x] =
            static_cast<uint8_t>((in[2 * x] + in[2 * x + 1] + in[2 * x + stride] + in[2 * x + stride + 1] + 2) >> 2);
      }
    }
  }
  return out;
}

std::vector<uint16_t> LuminanceCodes(const std::vector<float>& luminance) {
  std::vector<uint16_t> out(luminance.size());
  // As LuminanceCode, without branches and with constants that the compiler knows.
  constexpr float kSteps = Texels::kLuminanceSteps;
  const float* from = luminance.data();
  uint16_t* __restrict to = out.data();
  for (size_t i = 0; i < out.size(); ++i) {
    const float value = from[i];
    const float low = value > 0.0f ? value : 0.0f, both = low < 1.0f ? low : 1.0f;
    const auto code = static_cast<int32_t>(1.5f + both * kSteps);
    to[i] = static_cast<uint16_t>(value == value ? code : 0);  // NaN differs from itself
  }
  return out;
}

std::vector<uint8_t> LikelihoodStepsOf(const std::vector<float>& likelihoods) {
  std::vector<uint8_t> out(likelihoods.size());
  constexpr float kSteps = Texels::kLikelihoodSteps;
  const float* from = likelihoods.data();
  uint8_t* __restrict to = out.data();
  for (size_t i = 0; i < out.size(); ++i) {
    const float low = from[i] > 0.0f ? from[i] : 0.0f, both = low < 1.0f ? low : 1.0f;
    to[i] = static_cast<uint8_t>(static_cast<int32_t>(both * kSteps + 0.5f));
  }
  return out;
}

}  // namespace tessera
