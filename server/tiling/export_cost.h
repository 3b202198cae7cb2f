// Predicted cost of exports, stage by stage (common/exporting/export_parameters.h).
#pragma once

#include <vector>

#include "common/base/status.h"
#include "common/exporting/export_format.h"
#include "common/exporting/survey_sheets.h"
#include "server/tiling/cost_model.h"

namespace tessera {

// What the formats of a job read.
struct ExportNeeds {
  bool sheets = false;  // sheets of the result
  bool start = false;   // sheets of the start
  bool color = false;   // colours from the photographs
  bool views = false;   // the photographs of sheets, for colours or for a format
};
// The rows of options.formats, which exist.
std::vector<ExportFormat> FormatsOf(const ExportOptions& options);
ExportNeeds NeedsOf(const std::vector<ExportFormat>& formats, const ExportOptions& options);

Prediction PredictExportSplit(const Survey& survey, const ExportNeeds& needs);
Prediction PredictExportColor(const Survey& survey, const SurveySheet& sheet);
Prediction PredictExportSheet(const Survey& survey, const SurveySheet& sheet, const ExportFormat& format,
                              const ExportOptions& options);
Prediction PredictExportJoin(const Survey& survey, const ExportFormat& format);

// All tasks: sums, but the largest memory. Zero if the job exports nothing.
StatusOr<Prediction> PredictExports(const JobSettings& settings, const Survey& survey);

}  // namespace tessera
