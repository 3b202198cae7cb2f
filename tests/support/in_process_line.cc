#include "tests/support/in_process_line.h"

#include <algorithm>
#include <filesystem>

#include "common/job/task_parameters.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

StatusOr<LineTask> RunPlanned(const PlannedTask& planned, const SceneDescription& scene, const JobSettings& settings,
                              const std::string& folder, const std::vector<LineTask>& earlier,
                              const TaskRunner& runner) {
  LineTask task = {planned, folder + "/out", {}};
  const std::string input_dir = folder + "/in";
  TESSERA_RETURN_IF_ERROR(EnsureFolder(input_dir));
  TESSERA_RETURN_IF_ERROR(EnsureFolder(task.output_dir));
  const auto bring = [&](const fs::path& target, const std::string& name) {
    const fs::path link = fs::path(input_dir) / name;
    fs::create_directories(link.parent_path());
    fs::create_symlink(fs::absolute(target), link);
  };
  for (const PlannedInput& input : planned.inputs) {
    bring(fs::path(earlier.at(input.task.value()).output_dir) / input.output.str(), InputName(input));
  }
  const bool has_inspections = std::any_of(planned.inputs.begin(), planned.inputs.end(),
                                           [](const PlannedInput& input) { return input.output == kInspectionFile; });
  for (const int file : *planned.scene_files) {
    if (has_inspections && IsFetchedOnDemand(std::string(kSceneFolder) + "/" + scene.files.at(file))) continue;
    bring(scene.files.at(file) == kClassifierFile ? fs::path(settings.classifier)
                                                  : fs::path(scene.folder) / scene.files[file],
          std::string(kSceneFolder) + "/" + scene.files[file]);
  }
  for (const PlannedTask::ViewFile& file : *planned.view_files) {
    bring(fs::path(scene.folder) / scene.files.at(file.file), ViewInputName(file));
  }
  TaskRequest request = {planned.kind, planned.parameters, input_dir, task.output_dir};
  request.fetch = [&](const std::vector<std::string>& paths) -> Status {
    for (const std::string& path : paths) {
      if (FileExists(path)) continue;
      const std::string name = fs::path(path).lexically_relative(input_dir).generic_string();
      bring(fs::path(scene.folder) / fs::path(name).lexically_relative(kSceneFolder), name);
    }
    return absl::OkStatus();
  };
  TESSERA_ASSIGN_OR_RETURN(task.outcome, runner ? runner(request) : RunTask(request, TaskControl()));
  return task;
}

}  // namespace

StatusOr<std::vector<LineTask>> RunLine(const std::string& scene_dir, const std::string& work_dir,
                                        const JobSettings& settings, const TaskRunner& runner,
                                        const std::vector<FailedTile>& quarantined) {
  Warnings warnings;
  SceneLoadOptions load;
  load.to_be_classified = Classifies(settings);
  TESSERA_ASSIGN_OR_RETURN(SceneDescription scene, LoadScene(scene_dir, &warnings, load));
  if (load.to_be_classified && settings.classifier != kDefaultClassifier) {
    scene.files.insert(std::lower_bound(scene.files.begin(), scene.files.end(), kClassifierFile), kClassifierFile);
  }
  std::vector<LineTask> tasks;
  const auto run = [&](const std::vector<PlannedTask>& phase) -> Status {
    for (const PlannedTask& task : phase) {
      const std::string folder = work_dir + "/" + std::to_string(tasks.size());
      TESSERA_ASSIGN_OR_RETURN(LineTask done, RunPlanned(task, scene, settings, folder, tasks, runner));
      tasks.push_back(std::move(done));
    }
    return absl::OkStatus();
  };
  TESSERA_ASSIGN_OR_RETURN(const std::vector<PlannedTask> ingest, PlanIngest(settings, scene.files));
  TESSERA_RETURN_IF_ERROR(run(ingest));
  TESSERA_ASSIGN_OR_RETURN(const std::string survey, ReadFile(tasks.back().output_dir + "/" + kSurveyFile));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<PlannedTask> tiles, PlanTiles(settings, survey, scene.files));
  TESSERA_RETURN_IF_ERROR(run(tiles));
  const auto is_publish = [](const LineTask& task) { return task.planned.kind == kPublishKind; };
  if (std::any_of(tasks.begin(), tasks.end(), is_publish)) return tasks;
  std::vector<TileReads> reads;
  const auto is_cut = [](const LineTask& task) { return task.planned.kind == kCutKind; };
  const auto cuts = static_cast<int>(std::count_if(tasks.begin(), tasks.end(), is_cut));
  for (size_t t = 1; t < tasks.size(); ++t) {
    if (!is_cut(tasks[t])) continue;
    TESSERA_ASSIGN_OR_RETURN(const std::string json, ReadFile(tasks[t].output_dir + "/" + kReadsFile));
    TESSERA_ASSIGN_OR_RETURN(TileReads of_tile, ParseTileReads(json, tasks[t].planned.tile, cuts));
    const FailedTile not_cut = {tasks[t].planned.tile, kCutKind};
    if (std::find(quarantined.begin(), quarantined.end(), not_cut) == quarantined.end())
      reads.push_back(std::move(of_tile));
  }
  TESSERA_ASSIGN_OR_RETURN(const std::vector<PlannedTask> steps,
                           PlanSteps(settings, survey, scene.files, reads, nullptr, quarantined));
  TESSERA_RETURN_IF_ERROR(run(steps));
  return tasks;
}

}  // namespace tessera
