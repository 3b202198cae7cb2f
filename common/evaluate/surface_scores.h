// Scores of surface geometry: accuracy, completeness, F-score and normal consistency of measured points.
#pragma once

#include <cstdint>
#include <vector>

namespace tessera {

// One point of a surface measured against the other surface.
struct MeasuredPoint {
  double distance_m = 0;
  double normal_agreement = 0;  // |cosine| between the point's face normal and that of the nearest face
  int truth_class = -1;         // class of the truth at this point; -1: no label
};

// All figures are NaN if there are no points.
struct DistanceStatistics {
  int64_t points = 0;
  double mean_m = 0;
  double capped_mean_m = 0;  // mean of min(distance, cap)
  double median_m = 0;
  double percentile90_m = 0;
  double normal_consistency = 0;  // mean of normal_agreement
};

// F-score of Knapitsch et al., Tanks and Temples, 2017. Precision: the share of the result's points within `distance_m`
// of the truth. Recall: the share of the truth's points within `distance_m` of the result. F: their harmonic mean.
struct FScore {
  double distance_m = 0;
  double precision = 0, recall = 0, f = 0;
};

struct SurfaceScores {
  DistanceStatistics accuracy;      // points on the result against the truth
  DistanceStatistics completeness;  // points on the truth against the result
  std::vector<FScore> f_scores;
  double normal_consistency = 0;  // mean of both directions
};

DistanceStatistics ComputeStatistics(const std::vector<MeasuredPoint>& points, double cap_m);

// `on_result`: points of the result, measured against the truth; `on_truth`: the reverse. `truth_class` >= 0 restricts
// both to points of that class. Lengths in metres.
SurfaceScores ScoreSurface(const std::vector<MeasuredPoint>& on_result, const std::vector<MeasuredPoint>& on_truth,
                           double cap_m, const std::vector<double>& f_distances_m, int truth_class = -1);

}  // namespace tessera
