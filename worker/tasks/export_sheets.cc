#include "worker/tasks/export_sheets.h"

#include <algorithm>
#include <filesystem>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/exporting/survey_sheets.h"
#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "common/storage/zip_writer.h"
#include "worker/tasks/task_functions.h"

namespace tessera {
namespace {

std::string SheetInputName(const SheetId& id, bool colored) {
  return colored ? ColoredSheetFileName(id) : SheetFileName(id);
}

// Creates the folder of an output.
Status MakeFolderOf(const std::string& path) {
  return EnsureFolder(std::filesystem::path(path).parent_path().string());
}

Status MovePart(const std::string& folder, const std::string& path, bool has_faces) {
  TESSERA_RETURN_IF_ERROR(MakeFolderOf(path));
  if (!has_faces) return WriteFileAtomic(path, "no faces\n");
  return RenameDurably(absl::StrCat(folder, kPartFile), path);
}

// The names of the delivered files relative to `output_dir`. Names that a format made of a scene's names are checked.
StatusOr<std::vector<std::string>> Delivered(const std::string& folder_name, std::vector<std::string> names) {
  std::sort(names.begin(), names.end());
  for (std::string& name : names) {
    TESSERA_RETURN_IF_ERROR(JoinInside("/", name).status());
    name.insert(0, folder_name);
  }
  return names;
}

}  // namespace

StatusOr<ExportScene> ReadExportScene(const TaskRequest& request) {
  TESSERA_ASSIGN_OR_RETURN(const std::string json, ReadFile(InputPath(request, kExportSceneFile)));
  return ParseExportScene(json);
}

StatusOr<SheetInput> ReadSheetInput(const TaskRequest& request, const ExportParameters& parameters,
                                    const ExportScene& scene, const ExportOptions& options) {
  SheetInput input{scene, options, parameters.sheet, {}, {}, {}, {}, {}, {}, !parameters.set_aside.empty()};
  const auto read = [&](const std::string& name) { return ReadSheet(InputPath(request, name)); };
  TESSERA_ASSIGN_OR_RETURN(input.sheet, read(SheetInputName(parameters.sheet, parameters.colored)));
  for (const SheetId& id : parameters.sheets) {
    TESSERA_ASSIGN_OR_RETURN(Sheet neighbour, read(SheetInputName(id, parameters.colored)));
    if (!neighbour.faces.empty()) input.neighbours.push_back(std::move(neighbour));
  }
  if (parameters.start) {
    TESSERA_ASSIGN_OR_RETURN(Sheet start, read(StartSheetFileName(parameters.sheet)));
    input.start = std::move(start);
  }
  if (!parameters.views) return input;
  TESSERA_ASSIGN_OR_RETURN(const std::string json, ReadFile(InputPath(request, SheetViewsFileName(parameters.sheet))));
  TESSERA_ASSIGN_OR_RETURN(SheetViews views, ParseSheetViews(json));
  for (size_t i = 0; i < views.ids.size(); ++i) {
    const SceneView& view = views.views[i];
    if (view.image_path.empty()) continue;
    input.view_files.push_back(InputPath(request, ViewFileName(views.ids[i], false)));
    input.mask_files.push_back(view.mask_path.empty() ? "" : InputPath(request, ViewMaskName(views.ids[i])));
    input.views.push_back(view);
  }
  return input;
}

StatusOr<TaskOutcome> ExportSheet(const TaskRequest& request, const ExportParameters& parameters,
                                  const ExportFormat& format, const TaskControl& control) {
  TESSERA_ASSIGN_OR_RETURN(const ExportScene scene, ReadExportScene(request));
  TESSERA_ASSIGN_OR_RETURN(const ExportOptions options, ParseExportOptions(parameters.options));
  TESSERA_ASSIGN_OR_RETURN(const SheetInput input, ReadSheetInput(request, parameters, scene, options));
  const std::string folder_name = ExportFolderOf(format.name), folder = OutputPath(request, folder_name);
  const bool has_faces = !input.sheet.faces.empty();
  TaskOutcome outcome;
  if (has_faces) {
    TESSERA_RETURN_IF_ERROR(EnsureFolder(folder));
    TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> names, format.write_sheet(input, folder, control));
    TESSERA_ASSIGN_OR_RETURN(outcome.outputs, Delivered(folder_name, names));
    if (names.size() > 1) {
      const std::string archive = SheetArchiveName(format.name, parameters.sheet);
      std::vector<std::string> members = names;
      std::sort(members.begin(), members.end());
      TESSERA_RETURN_IF_ERROR(WriteStoredZip(OutputPath(request, archive), folder, members));
      for (const std::string& name : outcome.outputs) TESSERA_RETURN_IF_ERROR(RemoveTree(OutputPath(request, name)));
      outcome.outputs = {archive};
    }
  }
  if (format.has_part) {
    outcome.outputs.push_back(PartFileName(format.name, parameters.sheet));
    TESSERA_RETURN_IF_ERROR(MovePart(folder, OutputPath(request, outcome.outputs.back()), has_faces));
  }
  return outcome;
}

StatusOr<TaskOutcome> JoinExport(const TaskRequest& request, const ExportParameters& parameters,
                                 const ExportFormat& format, const TaskControl& control) {
  TESSERA_ASSIGN_OR_RETURN(const ExportScene scene, ReadExportScene(request));
  TESSERA_ASSIGN_OR_RETURN(const ExportOptions options, ParseExportOptions(parameters.options));
  TESSERA_ASSIGN_OR_RETURN(const std::string json, ReadFile(InputPath(request, kSheetListFile)));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<SheetId> listed, ParseSheetList(json));
  const std::set<SheetId> with_faces(listed.begin(), listed.end()),
      set_aside(parameters.set_aside.begin(), parameters.set_aside.end());
  TaskOutcome outcome;
  if (format.reads_changes && !parameters.changes) {
    outcome.warnings.push_back(absl::StrCat(std::string(format.name), ": the job has no ", kChangesGeoJsonFile,
                                            ", so that there is nothing to export: only an update with a new flight "
                                            "makes one"));
    return outcome;
  }
  JoinInput input{scene, options};
  input.warnings = &outcome.warnings;
  for (const SheetId& id : parameters.sheets) {
    if (!with_faces.contains(id)) continue;
    JoinInput::Item& item = input.sheets.emplace_back();
    item.id = id;
    if (format.join_reads_sheets) item.sheet_path = InputPath(request, SheetInputName(id, parameters.colored));
    if (format.has_part) item.part_path = InputPath(request, PartFileName(format.name, id));
    item.set_aside = set_aside.contains(id);
  }
  if (parameters.changes) input.changes_path = InputPath(request, kChangesGeoJsonFile);
  const std::string folder_name = ExportFolderOf(format.name), folder = OutputPath(request, folder_name);
  TESSERA_RETURN_IF_ERROR(EnsureFolder(folder));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> names, format.join(input, folder, control));
  TESSERA_ASSIGN_OR_RETURN(outcome.outputs, Delivered(folder_name, names));
  return outcome;
}

}  // namespace tessera
