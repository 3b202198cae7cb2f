// What report.html shows of report.json.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// Shares of image patches that match better than by chance.
struct FitFacts {
  double patches = 0, start = 0, result = 0;
  bool worse = false;  // the result as a whole fits worse than the start
};

struct RoundFacts {
  // Photo energy (1 - ZNCC, robust mean) at the first and the last step of the finest level.
  std::optional<double> energy_start, energy_end;
  std::optional<double> label_changes;
  double warped_pixels = 0;
};

struct TileFacts {
  int tile = -1;
  std::optional<double> faces, views, first_label_changes;  // of the label step before the first round
  std::optional<FitFacts> fit;
  std::vector<RoundFacts> rounds;
  bool quarantined = false;
};

// Everything but `scene` may be missing.
struct ReportFacts {
  std::string scene;
  std::optional<double> input_faces, input_vertices, faces, vertices, views, gsd_m, label_changes;
  std::optional<double> rms_m, median_m, p90_m, max_m;  // of the displacements
  std::optional<double> seam_samples, seam_different, seam_farthest_m;
  std::optional<FitFacts> fit;
  std::vector<std::string> classes;
  std::vector<std::pair<std::string, double>> shares_before, shares_after;  // of the area, by class
  std::vector<TileFacts> tiles;
  std::vector<std::string> warnings;
  std::vector<std::pair<std::string, std::string>> skipped_images;  // name and reason
  std::string frame;                                                // "frame" as JSON; empty: none
};

// `report_json`: the text of report.json. Fields that are missing or have another type are left empty. DATA_LOSS if the
// text is no JSON object.
StatusOr<ReportFacts> ParseReportFacts(const std::string& report_json);

}  // namespace tessera
