#include "common/evaluate/surface_scores.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tessera {
namespace {

constexpr double kUndefined = std::numeric_limits<double>::quiet_NaN();

// Interpolates linearly between order statistics, like NumPy's default.
double Quantile(const std::vector<double>& sorted, double q) {
  const double position = q * static_cast<double>(sorted.size() - 1);
  const size_t low = static_cast<size_t>(position);
  const size_t high = std::min(low + 1, sorted.size() - 1);
  return sorted[low] + (position - static_cast<double>(low)) * (sorted[high] - sorted[low]);
}

std::vector<MeasuredPoint> OfClass(const std::vector<MeasuredPoint>& points, int truth_class) {
  if (truth_class < 0) return points;
  std::vector<MeasuredPoint> kept;
  for (const MeasuredPoint& p : points) {
    if (p.truth_class == truth_class) kept.push_back(p);
  }
  return kept;
}

double ShareWithin(const std::vector<MeasuredPoint>& points, double distance_m) {
  if (points.empty()) return kUndefined;
  const auto within =
      std::count_if(points.begin(), points.end(), [&](const MeasuredPoint& p) { return p.distance_m <= distance_m; });
  return static_cast<double>(within) / static_cast<double>(points.size());
}

}  // namespace

DistanceStatistics ComputeStatistics(const std::vector<MeasuredPoint>& points, double cap_m) {
  if (points.empty()) return {0, kUndefined, kUndefined, kUndefined, kUndefined, kUndefined};
  DistanceStatistics statistics;
  std::vector<double> distances;
  distances.reserve(points.size());
  for (const MeasuredPoint& p : points) {
    statistics.mean_m += p.distance_m;
    statistics.capped_mean_m += std::min(p.distance_m, cap_m);
    statistics.normal_consistency += p.normal_agreement;
    distances.push_back(p.distance_m);
  }
  const double count = static_cast<double>(points.size());
  statistics.points = static_cast<int64_t>(points.size());
  statistics.mean_m /= count;
  statistics.capped_mean_m /= count;
  statistics.normal_consistency /= count;
  std::sort(distances.begin(), distances.end());
  statistics.median_m = Quantile(distances, 0.5);
  statistics.percentile90_m = Quantile(distances, 0.9);
  return statistics;
}

SurfaceScores ScoreSurface(const std::vector<MeasuredPoint>& on_result, const std::vector<MeasuredPoint>& on_truth,
                           double cap_m, const std::vector<double>& f_distances_m, int truth_class) {
  const std::vector<MeasuredPoint> result = OfClass(on_result, truth_class), truth = OfClass(on_truth, truth_class);
  SurfaceScores scores;
  scores.accuracy = ComputeStatistics(result, cap_m);
  scores.completeness = ComputeStatistics(truth, cap_m);
  for (double distance_m : f_distances_m) {
    FScore score{distance_m, ShareWithin(result, distance_m), ShareWithin(truth, distance_m), 0};
    const double sum = score.precision + score.recall;
    score.f = sum == 0 ? 0 : 2 * score.precision * score.recall / sum;
    scores.f_scores.push_back(score);
  }
  scores.normal_consistency = 0.5 * (scores.accuracy.normal_consistency + scores.completeness.normal_consistency);
  return scores;
}

}  // namespace tessera
