// Unary data of the label field: class likelihoods summed over the pixels that see each face.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/imaging/raster.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// Sums per face over all views added so far.
struct FaceLikelihoods {
  int classes = 0;
  std::vector<float> sum;     // faces x classes: summed likelihoods of the pixels that see the face
  std::vector<float> pixels;  // faces: number of these pixels

  FaceLikelihoods(size_t faces, int class_count)
      : classes(class_count), sum(faces * class_count, 0.0f), pixels(faces, 0.0f) {}
};

// Likelihoods as integers of which `per_unit` are a likelihood of 1, laid out like a Raster.
struct LikelihoodSteps {
  int width = 0, height = 0;
  std::span<const uint8_t> steps;
  float per_unit = 255;
};

// The part of a view's likelihoods that AddLikelihoods reads for the pixels of `window`: a rectangle relative to the
// first likelihood. `mapping`, `width`, `height`: of all likelihoods. With a copy of the part, and with first_x and
// first_y moved to it, AddLikelihoods gives the same sums, bit for bit.
PixelRect SampledPart(const PixelRect& window, const PixelMapping& mapping, int width, int height);

// Divides the faces that a view shows into disjoint sets, for loops that add the sets on several threads.
class FaceShares {
 public:
  static constexpr int kMost = 64;  // sets
  static constexpr int kRun = 64;   // pixels of a row for which it is known which sets they show

  FaceShares() = default;
  // `own`: flags of the faces to add; empty: all. `count`: of the sets, a power of two up to kMost.
  FaceShares(const FaceMap& map, const std::vector<uint8_t>& own, int count);

  // The set of a face.
  int Of(int32_t face) const { return (face >> kBlockBits) & (count_ - 1); }

  // Whether one of the kRun pixels of row y from column run * kRun shows a face of set `share`.
  bool InRun(int share, int y, int run) const {
    return count_ == 1 || runs_[static_cast<size_t>(y) * runs_of_row_ + run] >> share & 1;
  }

 private:
  static constexpr int kBlockBits = 10;  // neighbours share cache lines
  int count_ = 1, runs_of_row_ = 0;
  std::vector<uint64_t> runs_;  // a bit for each share
};

// Adds one view: each pixel of `map` that sees a face adds the likelihoods at the position given by `mapping`.
// `likelihoods`: one plane per class, sampled bilinearly, border values repeated. Not thread-safe on the same `sums`.
void AddLikelihoods(const FaceMap& map, const FloatImage& likelihoods, const PixelMapping& mapping,
                    FaceLikelihoods* sums);

// The same, equal bit for bit to that of the likelihoods as floats, for the faces of set `share` of `shares` with a
// flag in `own` (empty: all). `shares`: made from this map and `own`. Thread-safe on the same `sums` for different
// sets.
void AddLikelihoods(const FaceMap& map, const LikelihoodSteps& likelihoods, const PixelMapping& mapping,
                    const std::vector<uint8_t>& own, FaceLikelihoods* sums, const FaceShares& shares = {},
                    int share = 0);

}  // namespace tessera
