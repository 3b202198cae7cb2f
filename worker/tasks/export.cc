#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "common/exporting/color/color_sheet.h"
#include "common/exporting/export_parameters.h"
#include "common/storage/files.h"
#include "worker/tasks/export_sheets.h"
#include "worker/tasks/task_functions.h"

namespace tessera {
namespace {

// A sheet and its photographs → the sheet with the colours of its vertices.
StatusOr<TaskOutcome> ColorOneSheet(const TaskRequest& request, ExportParameters parameters,
                                    const TaskControl& control) {
  parameters.views = true;
  TESSERA_ASSIGN_OR_RETURN(const ExportScene scene, ReadExportScene(request));
  const ExportOptions options;
  TESSERA_ASSIGN_OR_RETURN(SheetInput input, ReadSheetInput(request, parameters, scene, options));
  if (!input.sheet.faces.empty()) {
    std::vector<Rgb> colors;
    TESSERA_RETURN_IF_ERROR(ColorSheet(input, &colors, control));
    input.sheet.colors = std::move(colors);
  }
  TaskOutcome outcome;
  outcome.outputs = {ColoredSheetFileName(parameters.sheet)};
  const std::string path = OutputPath(request, outcome.outputs.front());
  TESSERA_RETURN_IF_ERROR(EnsureFolder(path.substr(0, path.rfind('/'))));
  TESSERA_RETURN_IF_ERROR(WriteSheet(path, input.sheet));
  return outcome;
}

StatusOr<TaskOutcome> RunStage(const TaskRequest& request, const ExportParameters& parameters,
                               const TaskControl& control) {
  if (parameters.stage == ExportStage::kSplit) return SplitResult(request, parameters, control);
  if (parameters.stage == ExportStage::kColor) return ColorOneSheet(request, parameters, control);
  const ExportFormat* const format = FindExportFormat(parameters.format);
  const bool is_sheet = parameters.stage == ExportStage::kSheet;
  if (format == nullptr || (is_sheet ? format->write_sheet == nullptr : format->join == nullptr)) {
    return absl::InvalidArgumentError(absl::StrCat("export: no format '", parameters.format, "' with this stage"));
  }
  return is_sheet ? ExportSheet(request, parameters, *format, control)
                  : JoinExport(request, parameters, *format, control);
}

}  // namespace

StatusOr<TaskOutcome> RunExport(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const ExportParameters parameters, ParseExportParameters(request.parameters));
  TESSERA_ASSIGN_OR_RETURN(TaskOutcome outcome, RunStage(request, parameters, control));
  outcome.stats = nlohmann::json{{"files", outcome.outputs.size()}, {"seconds", SecondsSince(clock, start_us)}}.dump();
  return outcome;
}

}  // namespace tessera
