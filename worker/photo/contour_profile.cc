#include "worker/photo/contour_profile.h"

#include <algorithm>
#include <cmath>

namespace tessera {
namespace {

// Tuned on helsinki and campus for several qualities of likelihoods (accuracy_bench --rungs).
constexpr double kMinClear = 0.3;    // minimum contrast of the likelihoods: mean difference on both sides of the border
constexpr double kSpread_px = 1;     // expected spread of edges around an unbiased border
constexpr double kEdgeNoise = 0.02;  // in luminance: fainter edges get a small weight

}  // namespace

ContourMeasurement MeasureContour(const ContourProfile& profile, const BorderTrust& trust, double scale) {
  constexpr int n = ContourProfile::kPixels;
  // Find the border between pixels t - 1 and t that separates the classes best.
  double total = 0, before = 0, best = 0;
  for (const double gain : profile.front_gain) total += gain;
  int border = 0;
  for (int t = 1; t < n; ++t) {
    before += profile.front_gain[t - 1];
    if (2 * before - total <= best) continue;
    best = 2 * before - total;
    border = t;
  }
  // Only one class: the border is outside the profile.
  if (border == 0 || best <= std::abs(total)) return {};
  const double clear = best / n;
  const double centre = border - trust.bias_px * scale;
  if (clear < kMinClear || centre < 2 || centre > n - 2) return {};
  const double variance = trust.sigma_px * trust.sigma_px * scale * scale + kSpread_px * kSpread_px;
  double sum = 0, sum_t = 0, strongest = 0;
  for (int t = 2; t <= n - 2; ++t) {
    const double edge =
        0.5 * (profile.luminance[t] + profile.luminance[t + 1] - profile.luminance[t - 1] - profile.luminance[t - 2]);
    const double near = std::exp(-0.5 * (t - centre) * (t - centre) / variance);
    const double weight = near * (edge * edge + kEdgeNoise * kEdgeNoise);
    sum += weight;
    sum_t += weight * t;
    strongest = std::max(strongest, near * edge * edge);
  }
  return {sum_t / sum - ContourProfile::kReach,
          trust.weight * clear * strongest / (strongest + kEdgeNoise * kEdgeNoise)};
}

}  // namespace tessera
