#include "common/imaging/border_trust.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

constexpr int kLineStep = 2;            // rows or columns between two lines
constexpr double kMinMargin = 0.2;      // mean lead of a side's class over the other class
constexpr int kSidePixels = 3;          // pixels in the mean of a side
constexpr double kNoise = 0.01;         // of luminance; makes votes of flat regions uniform
constexpr double kFullContrast = 0.25;  // relative height of the peak that gives weight 1

// Neighbouring lines cross the same edge, so about this many borders count as one independent sample.
constexpr double kCorrelatedBorders = 20;
// Large biases vary over the image, so the weight decreases with the bias on this scale.
constexpr double kTypicalBias_px = 1.5;

}  // namespace

BorderTrusts::BorderTrusts(int classes) : classes_(classes), trusts_(static_cast<size_t>(classes) * classes) {}

void BorderTrusts::Set(int a, int b, const BorderTrust& trust) {
  trusts_[static_cast<size_t>(a) * classes_ + b] = trust;
  trusts_[static_cast<size_t>(b) * classes_ + a] = {-trust.bias_px, trust.sigma_px, trust.weight};
}

const BorderTrust& BorderTrusts::Of(int a, int b) const {
  static const BorderTrust kNone;
  if (a < 0 || b < 0 || a >= classes_ || b >= classes_) return kNone;
  return trusts_[static_cast<size_t>(a) * classes_ + b];
}

BorderCounts::BorderCounts(int classes) : classes_(classes), pairs_(static_cast<size_t>(classes) * classes) {}

void BorderCounts::Add(const FloatImage& luminance, const FloatImage& likelihoods) {
  if (likelihoods.channels != classes_ || likelihoods.empty()) return;
  for (int y = 0; y < luminance.height; y += kLineStep) {
    AddLine(luminance, likelihoods, {0, y, 1, 0, luminance.width});
  }
  for (int x = 0; x < luminance.width; x += kLineStep) {
    AddLine(luminance, likelihoods, {x, 0, 0, 1, luminance.height});
  }
}

void BorderCounts::Add(const BorderCounts& other) {
  for (size_t p = 0; p < pairs_.size(); ++p) {
    pairs_[p].borders += other.pairs_[p].borders;
    for (int t = 0; t < kOffsets; ++t) pairs_[p].edges[t] += other.pairs_[p].edges[t];
  }
}

// Each border votes for the positions of strong gradients around it. A vote has the fixed sum kVoteScale, so a border
// with high contrast counts as much as a weak one, and rounding it to integers makes the sum independent of the order.
void BorderCounts::AddLine(const FloatImage& luminance, const FloatImage& likelihoods, const Line& line) {
  const int n = line.length;
  std::vector<float> light(n), likely(static_cast<size_t>(n) * classes_);
  for (int i = 0; i < n; ++i) {
    const int x = line.x + i * line.dx, y = line.y + i * line.dy;
    light[i] = luminance.at(x, y);
    const auto scaled = [](int at, int size, int of) {
      return static_cast<int>((2 * int64_t{at} + 1) * of / (2 * size));
    };
    const int u = scaled(x, luminance.width, likelihoods.width), v = scaled(y, luminance.height, likelihoods.height);
    for (int l = 0; l < classes_; ++l) likely[static_cast<size_t>(i) * classes_ + l] = likelihoods.at(u, v, l);
  }
  // The likeliest class over three pixels, so that noise of single pixels does not create borders.
  std::vector<int> best(n, -1);
  for (int i = 1; i + 1 < n; ++i) {
    float most = 0;
    for (int l = 0; l < classes_; ++l) {
      const float* at = &likely[static_cast<size_t>(i) * classes_ + l];
      const float sum = at[-classes_] + at[0] + at[classes_];
      if (sum > most) {
        most = sum;
        best[i] = l;
      }
    }
  }
  for (int i = kHalfWidth_px; i + kHalfWidth_px <= n; ++i) {
    int a = best[i - 1], b = best[i];
    if (a < 0 || b < 0 || a == b) continue;
    // Skip places where one side has no clear class: the likelihoods end there, but no class border.
    float first = 0, second = 0;
    for (int k = 0; k < kSidePixels; ++k) {
      const float* before = &likely[static_cast<size_t>(i - 1 - k) * classes_];
      const float* after = &likely[static_cast<size_t>(i + k) * classes_];
      first += before[a] - before[b];
      second += after[b] - after[a];
    }
    if (!(std::min(first, second) >= kSidePixels * kMinMargin)) continue;
    // Squared difference of the means of two pixels on each side. NaN if any pixel is NaN.
    std::array<double, kOffsets> edges;
    double sum = 0;
    for (int t = 0; t < kOffsets; ++t) {
      const float* at = &light[i - kHalfWidth_px + t];
      const double edge = 0.5 * (at[2] + at[3] - at[0] - at[1]);
      edges[t] = edge * edge + kNoise * kNoise;
      sum += edges[t];
    }
    if (!std::isfinite(sum)) continue;
    const bool forward = a < b;
    if (!forward) std::swap(a, b);
    Pair& pair = At(a, b);
    for (int t = 0; t < kOffsets; ++t) {
      pair.edges[forward ? t : kOffsets - 1 - t] += std::llround(kVoteScale * edges[t] / sum);
    }
    ++pair.borders;
  }
}

// The peak of the histogram gives the bias, its width the deviation, and its height over both sides the weight. The
// height is reduced by the expected height of a random peak, so that few borders are not trusted by chance.
BorderTrust BorderCounts::TrustOf(const Pair& pair) {
  if (pair.borders < kMinBorders) return {};
  constexpr int kMiddle = kOffsets / 2;
  static_assert(kMiddle + kMaxBias_px + 4 < kOffsets);
  const auto mean3 = [&](int t) {
    return static_cast<double>(pair.edges[t - 1] + pair.edges[t] + pair.edges[t + 1]) / 3;
  };
  int peak = kMiddle;
  for (int t = kMiddle - kMaxBias_px; t <= kMiddle + kMaxBias_px; ++t) {
    if (mean3(t) > mean3(peak)) peak = t;
  }
  // Compare with the higher side: a slope is not a peak.
  const double beside = 0.5 * static_cast<double>(std::max(pair.edges[peak - 3] + pair.edges[peak - 4],
                                                           pair.edges[peak + 3] + pair.edges[peak + 4]));
  const double contrast = mean3(peak) / beside - 1 - std::sqrt(kCorrelatedBorders / static_cast<double>(pair.borders));
  if (!(contrast > 0)) return {};
  double sum = 0, first = 0, second = 0;
  for (int k = -2; k <= 2; ++k) {
    const double over = std::max(0.0, static_cast<double>(pair.edges[peak + k]) - beside);
    sum += over;
    first += over * k;
    second += over * k * k;
  }
  const double mean = first / sum;
  BorderTrust trust;
  trust.bias_px = kMiddle - (peak + mean);
  trust.sigma_px = std::sqrt(std::max(0.0, second / sum - mean * mean));
  const double biases = trust.bias_px / kTypicalBias_px;
  trust.weight = std::min(1.0, contrast / kFullContrast) / (1 + biases * biases);
  return trust;
}

std::vector<int64_t> BorderCounts::ToCounts() const {
  std::vector<int64_t> counts;
  for (const Pair& pair : pairs_) {
    counts.push_back(pair.borders);
    counts.insert(counts.end(), pair.edges.begin(), pair.edges.end());
  }
  return counts;
}

StatusOr<BorderCounts> BorderCounts::FromCounts(int classes, const std::vector<int64_t>& counts) {
  BorderCounts found(classes);
  constexpr size_t kOfPair = 1 + kOffsets;
  const bool negative = std::any_of(counts.begin(), counts.end(), [](int64_t count) { return count < 0; });
  if (counts.size() != found.pairs_.size() * kOfPair || negative) {
    return absl::InvalidArgumentError(
        absl::StrCat("border counts: found ", counts.size(), " values", negative ? ", some negative" : "",
                     ", expected ", found.pairs_.size() * kOfPair, " values of at least 0 for ", classes, " classes"));
  }
  for (size_t p = 0; p < found.pairs_.size(); ++p) {
    Pair& pair = found.pairs_[p];
    pair.borders = counts[p * kOfPair];
    std::copy_n(counts.begin() + static_cast<std::ptrdiff_t>(p * kOfPair) + 1, kOffsets, pair.edges.begin());
  }
  return found;
}

BorderTrusts BorderCounts::Trusts() const {
  BorderTrusts trusts(classes_);
  for (int a = 0; a < classes_; ++a) {
    for (int b = a + 1; b < classes_; ++b) trusts.Set(a, b, TrustOf(pairs_[static_cast<size_t>(a) * classes_ + b]));
  }
  return trusts;
}

}  // namespace tessera
