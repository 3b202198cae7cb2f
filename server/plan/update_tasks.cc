#include "server/plan/update_tasks.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "common/job/change_cells.h"
#include "server/plan/rollback.h"

namespace tessera {
namespace {

constexpr char kCarriedPrefix[] = ".base/";

struct SeenBlock {
  std::set<int32_t> views;  // new ones
  double seen_m2 = 0;       // of its ground, at most
};

// Blocks by y, x.
using SeenBlocks = std::map<std::array<int, 2>, SeenBlock>;

SeenBlocks BlocksThatNewViewsSee(const ChangeWork& work, double side_m) {
  const double cell_m = work.survey.ground.cell_m;
  const auto first = [&](int at) { return static_cast<int>(std::floor(at * cell_m / side_m)); };
  const auto last = [&](int at) { return static_cast<int>(std::ceil((at + 1) * cell_m / side_m)) - 1; };
  SeenBlocks blocks;
  for (const SurveyCell& cell : work.survey.cells) {
    const auto fresh = std::lower_bound(cell.views.begin(), cell.views.end(), static_cast<int32_t>(work.views_of_base));
    if (fresh == cell.views.end()) continue;
    for (int y = first(cell.y); y <= last(cell.y); ++y) {
      for (int x = first(cell.x); x <= last(cell.x); ++x) {
        SeenBlock& seen = blocks[{y, x}];
        seen.views.insert(fresh, cell.views.end());
        seen.seen_m2 = std::min(seen.seen_m2 + cell_m * cell_m, side_m * side_m);
      }
    }
  }
  return blocks;
}

PlannedTask CompareTask(const ChangeWork& work, const CellRect& cells, const SeenBlock& seen, double change_cell_m,
                        std::set<size_t>* tiles_near) {
  const double cell_m = work.survey.ground.cell_m, margin_m = kBlockMargin * change_cell_m + cell_m;
  CompareParameters parameters;
  parameters.cells = cells;
  parameters.views.assign(seen.views.begin(), seen.views.end());
  PlannedTask task;
  task.kind = "compare";
  task.name = absl::StrCat("compare block ", cells.x0 / kBlockCells, " ", cells.y0 / kBlockCells);
  task.inputs = {{work.base_from, kCityFile}, {work.survey_from, kPlainSurveyFile}};
  double pixels = 0;
  for (const int32_t v : parameters.views) {
    task.view_files.Edit().insert(task.view_files->end(), work.files_of_view[v].begin(), work.files_of_view[v].end());
    if (work.classified[v]) task.inputs.push_back(*work.classified[v]);
    const PinholeCamera& k = work.survey.views[v].camera.intrinsics;
    pixels += static_cast<double>(k.width) * k.height;
  }
  for (size_t t = 0; t < work.tiles.size(); ++t) {
    const CellRect& core = work.tiles[t].parameters.core;
    if (core.x1 * cell_m < cells.x0 * change_cell_m - margin_m ||
        core.x0 * cell_m > cells.x1 * change_cell_m + margin_m ||
        core.y1 * cell_m < cells.y0 * change_cell_m - margin_m ||
        core.y0 * cell_m > cells.y1 * change_cell_m + margin_m) {
      continue;
    }
    parameters.states.push_back(work.tiles[t].parameters.tile);
    task.inputs.push_back(work.tiles[t].before);
    tiles_near->insert(t);
  }
  task.parameters = ToJson(parameters);
  SetCost(PredictCompare(work.survey, pixels, seen.seen_m2 / (change_cell_m * change_cell_m)), &task);
  return task;
}

}  // namespace

CostScale CostsOf(const UpdateBase& base, const Survey& survey) {
  MeasuredCosts measured = base.measured;
  // It was planned before the survey told what the model takes for it.
  const auto ingest = measured.find(kIngestKind);
  if (ingest != measured.end()) ingest->second.predicted = PredictIngest(survey).core_seconds;
  return CostScale(measured);
}

std::vector<PlannedTask> PlanChanges(const ChangeWork& work) {
  const double change_cell_m = ChangeCellSize_m(work.survey.gsd_m);
  std::vector<PlannedTask> tasks;
  PlannedTask report;
  ChangesParameters parameters;
  parameters.scene_name = work.survey.scene_name;
  report.kind = report.name = kChangesKind;
  report.inputs = {{work.city_from, kCityFile}, {work.survey_from, kPlainSurveyFile}};
  std::set<size_t> tiles_near;
  for (const auto& [at, seen] : BlocksThatNewViewsSee(work, kBlockCells * change_cell_m)) {
    const auto& [y, x] = at;
    const CellRect cells = {x * kBlockCells, y * kBlockCells, (x + 1) * kBlockCells, (y + 1) * kBlockCells};
    report.inputs.push_back({TaskId(static_cast<int>(work.first_task + tasks.size())), ChangeBlockFile(cells)});
    parameters.blocks.push_back(cells);
    tasks.push_back(CompareTask(work, cells, seen, change_cell_m, &tiles_near));
  }
  if (tasks.empty()) return tasks;
  for (const size_t t : tiles_near) {
    if (!work.tiles[t].after) continue;
    parameters.states.push_back(work.tiles[t].parameters.tile);
    report.inputs.push_back(*work.tiles[t].after);
  }
  if (work.outdated) report.inputs.push_back(*work.outdated);
  parameters.outdated = work.outdated.has_value();
  report.parameters = ToJson(parameters);
  SetCost(PredictChanges(work.survey, static_cast<double>(parameters.blocks.size())), &report);
  tasks.push_back(std::move(report));
  return tasks;
}

std::string CarriedName(const NamedDigest& file) {
  // One that the base carries itself keeps its name.
  return IsCarried(file.name) ? file.name
                              : absl::StrCat(kCarriedPrefix, file.digest.sha256.substr(0, 16), "/", file.name);
}

bool IsCarried(const std::string& name) { return name.starts_with(kCarriedPrefix); }

bool LiesInScene(const std::string& name) { return !IsCarried(name) && name != kClassifierFile; }

StatusOr<std::vector<PlannedTask>> PlanUpdate(const JobSettings& settings, const std::vector<NamedDigest>& scene_files,
                                              const UpdateBase& base) {
  TESSERA_RETURN_IF_ERROR(CheckJobSettings(settings));
  if (!settings.update.rollback_to.empty()) return PlanRollback(base);
  if (base.tiles.size() != base.states.size() || base.tiles.empty()) {
    return absl::InvalidArgumentError(base.name + ": found no states of its tiles, expected a job that has succeeded");
  }
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(base.survey_json));
  std::map<std::string, std::string> name_of_content;  // in the job's list
  for (const NamedDigest& file : scene_files) name_of_content.emplace(file.digest.sha256, file.name);
  std::map<std::string, std::string> content_of_path;  // of images and likelihoods of the base
  std::map<std::string, std::string> classified;       // of images, where the base made the likelihoods
  for (const SceneView& view : survey.views) {
    if (!survey.classifier.empty()) classified[view.image_path] = view.likelihood_content;
    if (!view.image_path.empty()) content_of_path[view.image_path] = view.image_content;
    if (!view.likelihood_path.empty()) content_of_path[view.likelihood_path] = view.likelihood_content;
  }
  UpdateFiles files;
  std::map<std::string, UpdateFiles::Known> known_of_content;
  for (const NamedDigest& file : base.scene_files) {
    const auto pixels = content_of_path.find(file.name);
    if (pixels == content_of_path.end() && file.name != survey.mesh_path) continue;  // cameras and the like
    UpdateFiles::Known& known = known_of_content[file.digest.sha256];
    known.mesh = pixels == content_of_path.end();
    if (!known.mesh) known.content = pixels->second;
    if (const auto of = classified.find(file.name); of != classified.end()) known.classified = of->second;
    const auto name = name_of_content.find(file.digest.sha256);
    if (name == name_of_content.end()) return absl::InternalError(base.name + ": " + file.name + " is not carried on");
    files.carried[file.name] = name->second;
  }
  PlannedTask taken, update;
  taken.kind = kBaseKind;
  taken.name = absl::StrCat(kBaseKind, " ", base.name);
  taken.given.Edit() = {{kBaseSurveyFile, base.survey}, {kCityFile, base.city}};
  for (size_t t = 0; t < base.tiles.size(); ++t) {
    if (base.tiles[t].core.empty()) continue;
    taken.given.Edit().push_back({TileInputName(base.tiles[t].tile, kStateFile), base.states[t]});
  }
  if (base.outdated) taken.given.Edit().push_back({kOutdatedFile, *base.outdated});
  if (base.borders) taken.given.Edit().push_back({kBordersFile, *base.borders});
  bool other_mesh = false;  // there may be one
  update.kind = update.name = kUpdateKind;
  update.parameters =
      ToJson(UpdateParameters{IngestParametersOf(settings), settings.update.withdraw, settings.update.all_epochs});
  for (size_t i = 0; i < scene_files.size(); ++i) {
    if (!LiesInScene(scene_files[i].name)) continue;
    const auto known = known_of_content.find(scene_files[i].digest.sha256);
    if (known != known_of_content.end()) {
      files.known[scene_files[i].name] = known->second;
    } else {
      update.scene_files.Edit().push_back(static_cast<int>(i));
      other_mesh |= absl::EndsWithIgnoreCase(scene_files[i].name, ".ply");
    }
  }
  if (other_mesh) {  // is compared with the base's
    const auto mesh = std::find_if(scene_files.begin(), scene_files.end(), [&](const NamedDigest& file) {
      return file.name == files.carried[survey.mesh_path];
    });
    update.scene_files.Edit().push_back(static_cast<int>(mesh - scene_files.begin()));
    std::sort(update.scene_files.Edit().begin(), update.scene_files.Edit().end());
  }
  taken.given_contents.Edit().emplace_back(kFilesFile, ToJson(files));
  update.inputs = {{TaskId(0), kBaseSurveyFile}, {TaskId(0), kCityFile}, {TaskId(0), kFilesFile}};
  update.cost = kIngestSecondsPerFile * static_cast<double>(update.scene_files->size());
  return std::vector<PlannedTask>{std::move(taken), std::move(update)};
}

}  // namespace tessera
