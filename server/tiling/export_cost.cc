#include "server/tiling/export_cost.h"

#include <algorithm>

#include "server/settings/export_settings.h"

namespace tessera {
namespace {

// Bytes and seconds: first estimates, not fitted.
constexpr double kExportMiB = 1 << 20;
constexpr double kExportIdleBytes = 68 * kExportMiB;  // as cost_model.cc
constexpr double kSplitBytesPerFace = 16;             // of the city: mapped files and buffers
constexpr double kSplitSeconds = 1.2e-6;              // per face and set
constexpr double kSheetFileBytes = 37;                // per face: .5 vertices of 28, triangle, label, confidence
constexpr double kSheetBytes = 600;                   // per face in memory, with what a format builds of it
constexpr double kSheetSeconds = 6e-6;                // per face and format
constexpr double kNeighbourBytes = 60;                // per face of up to eight neighbours
constexpr double kRasterSeconds = 0.3e-6;             // per pixel of a raster at the GSD
constexpr double kPhotographSeconds = 24e-9;          // per pixel: decoded
constexpr double kPhotographBytes = 12;               // per pixel of the largest
constexpr double kColorSeconds = 0.15e-6;             // per face and view
constexpr double kDeliveredBytes = 40;                // per face and format
constexpr double kJoinSecondsPerSheet = 0.02;
constexpr double kExportTaskSeconds = 0.01;
constexpr double kJoinBytes = 256 * kExportMiB;

int64_t BytesOf(double bytes) { return static_cast<int64_t>(bytes); }

struct Photographs {
  double pixels = 0, largest = 0;
};

Photographs PhotographsOf(const Survey& survey, const SurveySheet& sheet) {
  Photographs all;
  for (const int32_t v : sheet.views) {
    const PinholeCamera& camera = survey.views[v].camera.intrinsics;
    const double pixels = static_cast<double>(camera.width) * camera.height;
    all.pixels += pixels;
    all.largest = std::max(all.largest, pixels);
  }
  return all;
}

}  // namespace

std::vector<ExportFormat> FormatsOf(const ExportOptions& options) {
  std::vector<ExportFormat> formats;
  for (const std::string& name : options.formats) formats.push_back(*FindExportFormat(name));
  return formats;
}

ExportNeeds NeedsOf(const std::vector<ExportFormat>& formats, const ExportOptions& options) {
  ExportNeeds needs;
  for (const ExportFormat& format : formats) {
    needs.sheets |= format.write_sheet != nullptr || format.join_reads_sheets;
    needs.start |= format.reads_start;
    needs.color |= format.colored && options.color == VertexColor::kImage;
    needs.views |= format.reads_photographs;
  }
  needs.views |= needs.color;
  return needs;
}

Prediction PredictExportSplit(const Survey& survey, const ExportNeeds& needs) {
  const double faces = needs.sheets ? static_cast<double>(survey.faces) : 0, sets = needs.start ? 2 : 1;
  return {kExportTaskSeconds + kSplitSeconds * sets * faces, BytesOf(kExportIdleBytes + kSplitBytesPerFace * faces),
          BytesOf(kSheetFileBytes * sets * faces)};
}

Prediction PredictExportColor(const Survey& survey, const SurveySheet& sheet) {
  const Photographs images = PhotographsOf(survey, sheet);
  const double faces = static_cast<double>(sheet.faces);
  return {kExportTaskSeconds + kPhotographSeconds * images.pixels +
              kColorSeconds * faces * static_cast<double>(sheet.views.size()),
          BytesOf(kExportIdleBytes + kSheetBytes * faces + kPhotographBytes * images.largest),
          BytesOf(kSheetFileBytes * faces)};
}

Prediction PredictExportSheet(const Survey& survey, const SurveySheet& sheet, const ExportFormat& format,
                              const ExportOptions& options) {
  const double faces = static_cast<double>(sheet.faces);
  const double side_m = kSheetCells * survey.ground.cell_m, gsd_m = options.gsd_m > 0 ? options.gsd_m : survey.gsd_m;
  Prediction sum = {kExportTaskSeconds + kSheetSeconds * faces, BytesOf(kExportIdleBytes + kSheetBytes * faces),
                    BytesOf(kDeliveredBytes * faces)};
  if (format.reads_neighbours) sum.peak_bytes += BytesOf(kNeighbourBytes * 8 * faces);
  if (format.reads_photographs) {
    const Photographs images = PhotographsOf(survey, sheet);
    sum.core_seconds += kPhotographSeconds * images.pixels + kRasterSeconds * (side_m / gsd_m) * (side_m / gsd_m);
    sum.peak_bytes += BytesOf(kPhotographBytes * images.largest);
  }
  return sum;
}

Prediction PredictExportJoin(const Survey& survey, const ExportFormat& format) {
  const double faces = static_cast<double>(survey.faces), sheets = static_cast<double>(SheetsOf(survey).size());
  Prediction sum = {kExportTaskSeconds + kJoinSecondsPerSheet * sheets, BytesOf(kExportIdleBytes + kJoinBytes), 0};
  if (format.join_reads_sheets) {
    sum.core_seconds += kSheetSeconds * faces;
    sum.stored_bytes = BytesOf(kDeliveredBytes * faces);
  }
  return sum;
}

StatusOr<Prediction> PredictExports(const JobSettings& settings, const Survey& survey) {
  Prediction sum;
  if (settings.exports.formats.empty()) return sum;
  TESSERA_ASSIGN_OR_RETURN(const ExportOptions options, ExportOptionsOf(settings.exports));
  const std::vector<ExportFormat> formats = FormatsOf(options);
  const ExportNeeds needs = NeedsOf(formats, options);
  sum += PredictExportSplit(survey, needs);
  const std::vector<SurveySheet> sheets = SheetsOf(survey);
  for (const SurveySheet& sheet : sheets) {
    if (needs.color) sum += PredictExportColor(survey, sheet);
  }
  for (const ExportFormat& format : formats) {
    for (const SurveySheet& sheet : sheets) {
      if (format.write_sheet != nullptr) sum += PredictExportSheet(survey, sheet, format, options);
    }
    if (format.join != nullptr) sum += PredictExportJoin(survey, format);
  }
  return sum;
}

}  // namespace tessera
