// Writes report.json: settings, tiles and statistics of the result.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "common/job/survey.h"
#include "common/storage/mapped_file.h"

namespace tessera {

struct ReportedTile {
  int tile = 0;
  std::string report;        // JSON of the tile's core
  bool quarantined = false;  // its refinement failed
};

// Statistics of the whole result, accumulated by vertex and face in order of their ids. Keeps only sums in memory,
// and one number per vertex on disk. Not thread-safe.
class ResultStatistics {
 public:
  // `scratch_folder` takes 8 bytes per vertex.
  static StatusOr<ResultStatistics> Create(const std::string& scratch_folder, size_t classes);
  void AddVertex(const Eigen::Vector3d& before, const Eigen::Vector3d& after);
  void AddFace(double area_before_m2, int32_t label_before, double area_after_m2, int32_t label_after);

 private:
  friend StatusOr<std::string> MakeReport(const Survey& survey, ResultStatistics statistics,
                                          const std::vector<ReportedTile>& tiles);
  ResultStatistics(ScratchList<double> lengths_m, size_t classes)
      : lengths_m_(std::move(lengths_m)), areas_before_m2_(classes + 1, 0.0), areas_after_m2_(classes + 1, 0.0) {}
  ScratchList<double> lengths_m_;  // of displacements
  double sum_squared_m2_ = 0;
  int64_t faces_ = 0, label_changes_ = 0;
  std::vector<double> areas_before_m2_, areas_after_m2_;  // per class; last: unlabelled
  double total_before_m2_ = 0, total_after_m2_ = 0;
};

// JSON, indented, deterministic (contains no times). "frame" is what exports need (ParseExportScene).
// RESOURCE_EXHAUSTED or INTERNAL if the scratch file cannot be written.
StatusOr<std::string> MakeReport(const Survey& survey, ResultStatistics statistics,
                                 const std::vector<ReportedTile>& tiles);

// The n-th smallest value (n from 0). Values must be at least 0. Reads them four times and takes 0.5 MiB.
double NthSmallest(std::span<const double> values, size_t n);

}  // namespace tessera
