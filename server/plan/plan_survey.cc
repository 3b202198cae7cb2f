// Phase 1 of a job: the tasks that make the survey.
#include <algorithm>
#include <map>
#include <numeric>
#include <set>
#include <string>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "common/scene/image_files.h"
#include "server/plan/export_tasks.h"
#include "server/plan/graph.h"
#include "server/plan/rollback.h"

namespace tessera {
namespace {

// Core-seconds, fitted to what campus, block and helsinki used (tests/bench/scaling.md): of an inspection, per pixel
// file and per MB of them; of ingest, per MB of the mesh, and per MB of the pixel files that it compares.
constexpr double kInspectSecondsPerFile = 0.0045, kInspectSecondsPerMb = 0.065;
constexpr double kIngestSeconds = 0.2, kIngestSecondsPerMeshMb = 0.66, kIngestSecondsPerPixelMb = 0.03;
// Files that an inspect task has at most, if no view has more. The tasks do not depend on the number of workers, so
// that their results are found again.
constexpr size_t kInspectedFiles = 16;
constexpr double kFilesOfFit = 150;  // that ingest reads in any case, about

// The files of the camera model that poses are read from, and scene.json.
bool IsOfCameras(const std::string& name) {
  const std::string base = name.substr(name.rfind('/') + 1);
  return !base.starts_with("points3D") && (base.ends_with(".json") || base.ends_with(".txt") || base.ends_with(".bin"));
}

IngestParameters IngestParametersOf(const JobSettings& settings) {
  return {settings.method_settings.partners,
          settings.method_settings.views_per_direction,
          Classifies(settings),
          settings.classifier == kDefaultClassifier,
          settings.skip_images,
          settings.anyway};
}

// Adds tasks that inspect the pixel files among `files`, indices in `scene_files`, and makes `task`, which reads all of
// these files, read their results. The files of a view go to one task if their names say so. Adds none where one task
// would inspect all of them.
void AddInspections(const JobSettings& settings, const std::vector<std::string>& scene_files,
                    const std::vector<int>& files, std::vector<PlannedTask>* tasks, PlannedTask* task,
                    IngestParameters* parameters) {
  std::map<std::string, std::vector<int>> views;
  std::vector<int> common;
  for (const int file : files) {
    const std::string& name = scene_files[file];
    if (!LiesInScene(name)) continue;
    if (IsPixelFile(name)) {
      views[PixelStem(name)].push_back(file);
    } else if (IsOfCameras(name)) {
      common.push_back(file);
    }
  }
  std::vector<std::vector<int>> parts;
  for (const auto& [stem, of_view] : views) {
    if (parts.empty() || parts.back().size() + of_view.size() > kInspectedFiles) parts.emplace_back();
    parts.back().insert(parts.back().end(), of_view.begin(), of_view.end());
  }
  if (parts.size() < 2) return;
  for (std::vector<int>& part : parts) {
    PlannedTask inspect;
    inspect.kind = kInspectKind;
    inspect.name = absl::StrCat(kInspectKind, " part ", parameters->inspections);
    inspect.parameters = ToJson(InspectParameters{Classifies(settings)});
    part.insert(part.end(), common.begin(), common.end());
    std::sort(part.begin(), part.end());
    inspect.scene_files.Edit() = std::move(part);
    task->inputs.push_back(
        {TaskId(static_cast<int>(tasks->size())), kInspectionFile, /*of_tile=*/parameters->inspections++});
    tasks->push_back(std::move(inspect));
  }
}

bool IsMeshFile(const std::string& name) {
  const auto ends = [&](const char* extension) { return absl::EndsWithIgnoreCase(name, extension); };
  return ends(".ply") || ends(".obj") || ends(".glb") || ends(".gltf");
}

// Sets the predicted times of inspections, ingest and update from the files that they read: the cost model needs a
// survey, which does not exist yet.
void PredictSurveyTasks(const std::vector<std::string>& scene_files, const std::vector<int64_t>& size_bytes,
                        std::vector<PlannedTask>* tasks) {
  const bool inspected =
      std::any_of(tasks->begin(), tasks->end(), [](const PlannedTask& task) { return task.kind == kInspectKind; });
  for (PlannedTask& task : *tasks) {
    const bool inspects = task.kind == kInspectKind;
    if (!inspects && task.kind != kIngestKind && task.kind != kUpdateKind) continue;
    double pixel_files = 0, pixel_mb = 0, mesh_mb = 0;
    for (const int file : *task.scene_files) {
      const std::string& name = scene_files[file];
      const double mb = size_bytes.empty() ? 1 : 1e-6 * static_cast<double>(size_bytes[file]);
      if (IsPixelFile(name)) {
        pixel_mb += mb;
        ++pixel_files;
      }
      if (IsMeshFile(name)) mesh_mb += mb;
    }
    task.cost = 0;
    if (inspects || !inspected) task.cost += kInspectSecondsPerFile * pixel_files + kInspectSecondsPerMb * pixel_mb;
    if (inspects) continue;
    const double compared = pixel_files > kFilesOfFit ? kFilesOfFit / pixel_files : 1;
    task.cost += kIngestSeconds + kIngestSecondsPerMeshMb * mesh_mb + kIngestSecondsPerPixelMb * compared * pixel_mb;
  }
}

}  // namespace

StatusOr<std::vector<PlannedTask>> PlanIngest(const JobSettings& settings, const std::vector<std::string>& scene_files,
                                              const std::vector<int64_t>& size_bytes) {
  TESSERA_RETURN_IF_ERROR(CheckJobSettings(settings));
  if (scene_files.empty()) return absl::InvalidArgumentError("the scene has no files");
  PlannedTask task;
  task.kind = task.name = kIngestKind;
  std::vector<int>& files = task.scene_files.Edit();
  files.resize(scene_files.size());
  std::iota(files.begin(), files.end(), 0);
  std::vector<PlannedTask> tasks;
  IngestParameters parameters = IngestParametersOf(settings);
  parameters.coarse_faces = FirstFineStepOf(settings) > 0;
  AddInspections(settings, scene_files, files, &tasks, &task, &parameters);
  task.parameters = ToJson(parameters);
  tasks.push_back(std::move(task));
  PredictSurveyTasks(scene_files, size_bytes, &tasks);
  return tasks;
}

StatusOr<std::vector<PlannedTask>> PlanUpdate(const JobSettings& settings, const std::vector<NamedDigest>& scene_files,
                                              const UpdateBase& base) {
  TESSERA_RETURN_IF_ERROR(CheckJobSettings(settings));
  if (!settings.update.rollback_to.empty()) return PlanRollback(base);
  if (settings.update.export_only) {
    std::vector<std::string> names;
    for (const NamedDigest& file : scene_files) names.push_back(file.name);
    return PlanExportOnly(settings, names, base);
  }
  if (base.tiles.size() != base.states.size() || base.tiles.empty()) {
    return absl::InvalidArgumentError(base.name +
                                      ": found no final states of its tiles, expected a succeeded job as base");
  }
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(base.survey_json));
  std::map<std::string, std::string> name_of_content;  // in `scene_files`
  for (const NamedDigest& file : scene_files) name_of_content.emplace(file.digest.sha256, file.name);
  std::map<std::string, std::string> content_of_path;  // of images and likelihoods of the base
  // Images with masks, and these: image_content depends on both files.
  std::set<std::string> read_again;
  std::map<std::string, std::string> classified;  // of images, if the base computed likelihoods
  for (const SceneView& view : survey.views) {
    if (!view.mask_path.empty()) {
      read_again.insert({view.image_path, view.mask_path});
      if (!view.likelihood_path.empty()) content_of_path[view.likelihood_path] = view.likelihood_content;
      continue;
    }
    if (!survey.classifier.empty()) classified[view.image_path] = view.likelihood_content;
    if (!view.image_path.empty()) content_of_path[view.image_path] = view.image_content;
    if (!view.likelihood_path.empty()) content_of_path[view.likelihood_path] = view.likelihood_content;
  }
  UpdateFiles files;
  std::map<std::string, UpdateFiles::Known> known_of_content;
  for (const NamedDigest& file : base.scene_files) {
    const auto pixels = content_of_path.find(file.name);
    const bool again = read_again.contains(file.name);
    if (pixels == content_of_path.end() && file.name != survey.mesh_path && !again) continue;  // such as cameras
    if (!again) {
      UpdateFiles::Known& known = known_of_content[file.digest.sha256];
      known.mesh = pixels == content_of_path.end();
      if (!known.mesh) known.content = pixels->second;
      if (const auto of = classified.find(file.name); of != classified.end()) known.classified = of->second;
    }
    const auto name = name_of_content.find(file.digest.sha256);
    if (name == name_of_content.end())
      return absl::InternalError(base.name + ": " + file.name + " is missing from the update's files");
    files.carried[file.name] = name->second;
  }
  PlannedTask taken = BaseTask(base, {{kBaseSurveyFile, base.survey}, {kCityFile, base.city}});
  PlannedTask update;
  bool other_mesh = false;  // the scene may have a new mesh
  update.kind = update.name = kUpdateKind;
  for (size_t i = 0; i < scene_files.size(); ++i) {
    if (!LiesInScene(scene_files[i].name)) continue;
    const auto known = known_of_content.find(scene_files[i].digest.sha256);
    if (known != known_of_content.end()) {
      files.known[scene_files[i].name] = known->second;
    } else {
      update.scene_files.Edit().push_back(static_cast<int>(i));
      other_mesh |= IsMeshFile(scene_files[i].name);
    }
  }
  if (other_mesh) {  // the update compares it with the base's mesh
    const auto mesh = std::find_if(scene_files.begin(), scene_files.end(), [&](const NamedDigest& file) {
      return file.name == files.carried[survey.mesh_path];
    });
    update.scene_files.Edit().push_back(static_cast<int>(mesh - scene_files.begin()));
    std::sort(update.scene_files.Edit().begin(), update.scene_files.Edit().end());
  }
  taken.given_contents.Edit().emplace_back(kFilesFile, ToJson(files));
  update.inputs = {{TaskId(0), kBaseSurveyFile}, {TaskId(0), kCityFile}, {TaskId(0), kFilesFile}};
  std::vector<std::string> names;
  std::vector<int64_t> size_bytes;
  for (const NamedDigest& file : scene_files) {
    names.push_back(file.name);
    size_bytes.push_back(file.digest.size_bytes);
  }
  std::vector<PlannedTask> tasks = {std::move(taken)};
  UpdateParameters parameters = {IngestParametersOf(settings), settings.update.withdraw, settings.update.all_epochs};
  AddInspections(settings, names, *update.scene_files, &tasks, &update, &parameters.ingest);
  update.parameters = ToJson(parameters);
  tasks.push_back(std::move(update));
  PredictSurveyTasks(names, size_bytes, &tasks);
  return tasks;
}

}  // namespace tessera
