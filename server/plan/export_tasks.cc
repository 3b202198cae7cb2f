#include "server/plan/export_tasks.h"

#include <algorithm>
#include <map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/exporting/export_parameters.h"
#include "common/exporting/survey_sheets.h"
#include "server/settings/export_settings.h"
#include "server/tiling/export_cost.h"

namespace tessera {
namespace {

bool CoreMeets(const CellRect& a, const CellRect& b) {
  return a.x0 < b.x1 && b.x0 < a.x1 && a.y0 < b.y1 && b.y0 < a.y1;
}

class ExportPlanner {
 public:
  ExportPlanner(const ExportWork& work, std::string scene_json)
      : work_(work),
        scene_json_(std::move(scene_json)),
        needs_(NeedsOf(work.formats, work.options)),
        sheets_(SheetsOf(work.survey)) {
    for (size_t i = 0; i < sheets_.size(); ++i) {
      const SheetId& id = sheets_[i].id;
      ids_.push_back(id);
      index_[id] = i;
      for (const CellRect& core : work_.quarantined) {
        if (!CoreMeets(core, CellsOf(id))) continue;
        set_aside_.push_back(id);
        break;
      }
    }
  }

  std::vector<PlannedTask> Plan() && {
    AddSplit();
    if (needs_.color) AddColors();
    for (const ExportFormat& format : work_.formats) AddFormat(format);
    return std::move(tasks_);
  }

 private:
  TaskId Add(PlannedTask task, const ExportParameters& parameters, const Prediction& cost) {
    task.kind = kExportKind;
    task.parameters = ToJson(parameters);
    SetCost(cost, &task);
    tasks_.push_back(std::move(task));
    return TaskId(static_cast<int>(work_.first_task + tasks_.size()) - 1);
  }

  void AddSplit() {
    ExportParameters parameters;
    parameters.stage = ExportStage::kSplit;
    parameters.scene = scene_json_;
    parameters.start = needs_.start;
    parameters.views = needs_.views;
    PlannedTask task;
    task.name = absl::StrCat(kExportKind, " split");
    if (needs_.sheets) {
      parameters.sheets = ids_;
      task.inputs = {{work_.mesh_from, kMeshFile}, {work_.city_from, kCityFile}};
    }
    if (needs_.views) task.inputs.push_back({work_.survey_from, kPlainSurveyFile});
    split_ = Add(std::move(task), parameters, PredictExportSplit(work_.survey, needs_));
  }

  void AddColors() {
    for (const SurveySheet& sheet : sheets_) {
      ExportParameters parameters;
      parameters.stage = ExportStage::kColor;
      parameters.sheet = sheet.id;
      PlannedTask task;
      task.name = absl::StrCat(kExportKind, " color ", SheetName(sheet.id));
      task.inputs = {{split_, kExportSceneFile}, SheetInputOf(sheet.id, /*colored=*/false)};
      AddNeighbours(/*colored=*/false, &parameters, &task);
      AddViews(sheet, &task);
      colored_.push_back(Add(std::move(task), parameters, PredictExportColor(work_.survey, sheet)));
    }
  }

  void AddFormat(const ExportFormat& format) {
    ExportOptions options = work_.options;
    options.formats = {std::string(format.name)};
    ExportParameters parameters;
    parameters.format = format.name;
    parameters.options = ExportOptionsToJson(options);
    parameters.colored = needs_.color && format.colored;
    std::vector<TaskId> made;
    if (format.write_sheet != nullptr) {
      for (const SurveySheet& sheet : sheets_) made.push_back(AddSheet(format, options, parameters, sheet));
    }
    if (format.join == nullptr) return;
    parameters.stage = ExportStage::kJoin;
    parameters.sheets = ids_;
    parameters.set_aside = set_aside_;
    PlannedTask task;
    task.name = absl::StrCat(kExportKind, " ", parameters.format, " join");
    task.inputs = {{split_, kExportSceneFile}, {split_, kSheetListFile}};
    for (size_t i = 0; i < ids_.size(); ++i) {
      if (format.has_part && i < made.size()) task.inputs.push_back({made[i], PartFileName(format.name, ids_[i])});
      if (format.join_reads_sheets) task.inputs.push_back(SheetInputOf(ids_[i], parameters.colored));
    }
    if (format.reads_changes && work_.changes) {  // else the task tells that there are none
      parameters.changes = true;
      task.inputs.push_back(*work_.changes);
    }
    Add(std::move(task), parameters, PredictExportJoin(work_.survey, format));
  }

  TaskId AddSheet(const ExportFormat& format, const ExportOptions& options, ExportParameters parameters,
                  const SurveySheet& sheet) {
    parameters.stage = ExportStage::kSheet;
    parameters.sheet = sheet.id;
    if (std::find(set_aside_.begin(), set_aside_.end(), sheet.id) != set_aside_.end()) {
      parameters.set_aside = {sheet.id};
    }
    PlannedTask task;
    task.name = absl::StrCat(kExportKind, " ", parameters.format, " ", SheetName(sheet.id));
    task.inputs = {{split_, kExportSceneFile}, SheetInputOf(sheet.id, parameters.colored)};
    if (format.reads_neighbours) AddNeighbours(parameters.colored, &parameters, &task);
    if (format.reads_start) {
      parameters.start = true;
      task.inputs.push_back({split_, StartSheetFileName(sheet.id)});
    }
    if (format.reads_photographs) {
      parameters.views = true;
      AddViews(sheet, &task);
    }
    return Add(std::move(task), parameters, PredictExportSheet(work_.survey, sheet, format, options));
  }

  PlannedInput SheetInputOf(const SheetId& id, bool colored) const {
    if (!colored) return {split_, SheetFileName(id)};
    return {colored_[index_.at(id)], ColoredSheetFileName(id)};
  }

  void AddNeighbours(bool colored, ExportParameters* parameters, PlannedTask* task) const {
    const SheetId& id = parameters->sheet;
    for (int y = id.y - 1; y <= id.y + 1; ++y) {
      for (int x = id.x - 1; x <= id.x + 1; ++x) {
        if ((x == id.x && y == id.y) || !index_.contains({x, y})) continue;
        parameters->sheets.push_back({x, y});
        task->inputs.push_back(SheetInputOf({x, y}, colored));
      }
    }
  }

  // Photographs and masks. SheetViewsFileName has the hashes of their pixels, so keys need not contain the files.
  void AddViews(const SurveySheet& sheet, PlannedTask* task) const {
    task->inputs.push_back({split_, SheetViewsFileName(sheet.id)});
    for (const int32_t v : sheet.views) {
      for (const PlannedTask::ViewFile& file : work_.files_of_view[v]) {
        if (!file.likelihoods) task->view_files.Edit().push_back(file);
      }
    }
  }

  const ExportWork& work_;
  const std::string scene_json_;
  const ExportNeeds needs_;
  const std::vector<SurveySheet> sheets_;
  std::vector<SheetId> ids_, set_aside_;
  std::map<SheetId, size_t> index_;  // in sheets_
  TaskId split_;
  std::vector<TaskId> colored_;  // a task a sheet
  std::vector<PlannedTask> tasks_;
};

}  // namespace

StatusOr<std::vector<PlannedTask>> PlanExports(const ExportWork& work) {
  TESSERA_ASSIGN_OR_RETURN(const ExportScene scene, ExportSceneOf(work.survey));
  return ExportPlanner(work, ExportSceneToJson(scene)).Plan();
}

StatusOr<std::vector<PlannedTask>> PlanExportOnly(const JobSettings& settings,
                                                  const std::vector<std::string>& scene_files, const UpdateBase& base) {
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(base.survey_json));
  TESSERA_RETURN_IF_ERROR(CheckExports(settings, survey));
  TESSERA_ASSIGN_OR_RETURN(const ExportOptions options, ExportOptionsOf(settings.exports));
  TESSERA_ASSIGN_OR_RETURN(const auto files_of_view, FilesOfViews(survey, scene_files));
  ExportWork work = {options,   FormatsOf(options), survey,    files_of_view,
                     TaskId(0), TaskId(0),          TaskId(0), /*first_task=*/1};
  for (const int tile : base.quarantined) work.quarantined.push_back(base.tiles[tile].core);
  PlannedTask taken;
  taken.kind = kBaseKind;
  taken.name = absl::StrCat(kBaseKind, " ", base.name);
  taken.given.Edit() = {{kPlainSurveyFile, base.plain}, {kCityFile, base.city}, {kMeshFile, base.mesh}};
  if (base.changes) {
    taken.given.Edit().push_back({kChangesGeoJsonFile, *base.changes});
    work.changes = PlannedInput{TaskId(0), kChangesGeoJsonFile};
  }
  TESSERA_ASSIGN_OR_RETURN(std::vector<PlannedTask> tasks, PlanExports(work));
  tasks.insert(tasks.begin(), std::move(taken));
  return tasks;
}

}  // namespace tessera
