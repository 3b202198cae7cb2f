// How far the borders between classes in likelihoods can be trusted, measured against the edges of the images.
#ifndef TESSERA_COMMON_IMAGING_BORDER_TRUST_H_
#define TESSERA_COMMON_IMAGING_BORDER_TRUST_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/raster.h"

namespace tessera {

// Where images have their edges about the places where likelihoods go over from one class to another: a classifier
// that puts the border of roofs two pixels too far out finds most edges two pixels inside.
struct BorderTrust {
  double bias_px = 0;   // how far the likelihoods' border lies from the images' edge, towards the second class
  double sigma_px = 0;  // standard deviation of the edges about that place
  double weight = 0;    // in [0, 1]; 0: edges lie anywhere, so that nothing is known of the border
  friend bool operator==(const BorderTrust&, const BorderTrust&) = default;
};

// Of all ordered pairs of classes.
class BorderTrusts {
 public:
  BorderTrusts() = default;  // none is known
  explicit BorderTrusts(int classes);
  // From class `a` to class `b`; sets that from `b` to `a` as well.
  void Set(int a, int b, const BorderTrust& trust);
  const BorderTrust& Of(int a, int b) const;
  int classes() const { return classes_; }
  friend bool operator==(const BorderTrusts&, const BorderTrusts&) = default;

 private:
  int classes_ = 0;
  std::vector<BorderTrust> trusts_;
};

// Counts of one image or of many, in whole numbers: in whatever order they are added, the sum is the same. Pixels are
// those of the images.
class BorderCounts {
 public:
  static constexpr int kReach = 11;                // pixels on either side of a border that are looked at
  static constexpr int kOffsets = 2 * kReach - 3;  // places where an edge may lie
  static constexpr int kMaxBias_px = 5;
  static constexpr int64_t kMinBorders = 500;  // fewer prove nothing

  explicit BorderCounts(int classes);

  // The borders along every second row and column. `luminance`: in [0, 1], NaN where invalid; borders beside such
  // pixels do not count. `likelihoods`: a plane a class, of the same field of view, of any resolution.
  void Add(const FloatImage& luminance, const FloatImage& likelihoods);
  void Add(const BorderCounts& other);

  BorderTrusts Trusts() const;

  // All counts as one list, pair by pair, and back. INVALID_ARGUMENT if `counts` is not such a list.
  std::vector<int64_t> ToCounts() const;
  static StatusOr<BorderCounts> FromCounts(int classes, const std::vector<int64_t>& counts);

 private:
  static constexpr double kVote = 1 << 20;
  struct Pair {
    int64_t borders = 0;
    std::array<int64_t, kOffsets> edges = {};  // by offset; kVote a border together
  };
  struct Line {
    int x = 0, y = 0, dx = 0, dy = 0, length = 0;
  };
  Pair& At(int a, int b) { return pairs_[static_cast<size_t>(a) * classes_ + b]; }
  void AddLine(const FloatImage& luminance, const FloatImage& likelihoods, const Line& line);
  static BorderTrust TrustOf(const Pair& pair);

  int classes_;
  std::vector<Pair> pairs_;  // from the class of lower index to that of the higher
};

}  // namespace tessera

#endif  // TESSERA_COMMON_IMAGING_BORDER_TRUST_H_
