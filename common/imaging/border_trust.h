// Reliability of class borders in likelihoods, estimated from the intensity edges of the images.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/raster.h"

namespace tessera {

// Distribution of image edges around the borders between two classes in the likelihoods. Example: if a classifier
// places roof borders two pixels too far outside, most edges lie two pixels inside.
struct BorderTrust {
  double bias_px = 0;   // offset of the likelihoods' border from the image edge, towards the second class
  double sigma_px = 0;  // standard deviation of the edges' positions
  double weight = 0;    // in [0, 1]; 0: edges show no peak, so the border is unreliable
  friend bool operator==(const BorderTrust&, const BorderTrust&) = default;
};

// The BorderTrust of each ordered pair of classes.
class BorderTrusts {
 public:
  BorderTrusts() = default;  // no classes: Of() returns weight 0
  explicit BorderTrusts(int classes);
  // Sets the value from class `a` to class `b`, and the mirrored one from `b` to `a`.
  void Set(int a, int b, const BorderTrust& trust);
  const BorderTrust& Of(int a, int b) const;
  int classes() const { return classes_; }
  friend bool operator==(const BorderTrusts&, const BorderTrusts&) = default;

 private:
  int classes_ = 0;
  std::vector<BorderTrust> trusts_;
};

// Histograms of edge positions around class borders, summed over images. Counts are integers, so that their sum does
// not depend on the order of addition. Offsets are in pixels of the image.
class BorderCounts {
 public:
  static constexpr int kHalfWidth_px = 11;                // pixels used on each side of a border
  static constexpr int kOffsets = 2 * kHalfWidth_px - 3;  // possible positions of an edge
  static constexpr int kMaxBias_px = 5;
  static constexpr int64_t kMinBorders = 500;  // with fewer borders the weight is 0

  explicit BorderCounts(int classes);

  // Adds the borders on every second row and column of an image. `luminance`: in [0, 1], NaN where invalid; borders
  // near invalid pixels are skipped. `likelihoods`: one plane per class, same field of view, any resolution.
  void Add(const FloatImage& luminance, const FloatImage& likelihoods);
  void Add(const BorderCounts& other);

  int classes() const { return classes_; }
  BorderTrusts Trusts() const;

  // Conversion to and from a flat list, pair by pair. INVALID_ARGUMENT if `counts` has a wrong length or negative
  // values.
  std::vector<int64_t> ToCounts() const;
  static StatusOr<BorderCounts> FromCounts(int classes, const std::vector<int64_t>& counts);

 private:
  static constexpr double kVoteScale = 1 << 20;
  struct Pair {
    int64_t borders = 0;
    std::array<int64_t, kOffsets> edges = {};  // by offset; each border adds kVoteScale in total
  };
  struct Line {
    int x = 0, y = 0, dx = 0, dy = 0, length = 0;
  };
  Pair& At(int a, int b) { return pairs_[static_cast<size_t>(a) * classes_ + b]; }
  void AddLine(const FloatImage& luminance, const FloatImage& likelihoods, const Line& line);
  static BorderTrust TrustOf(const Pair& pair);

  int classes_;
  std::vector<Pair> pairs_;  // only entries with a < b are used
};

}  // namespace tessera
