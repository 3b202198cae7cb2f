#include "tests/support/in_process_line.h"

#include <algorithm>
#include <filesystem>
#include <map>
#include <optional>

#include "common/job/task_parameters.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "server/plan/crop_tasks.h"

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
  FetchedOnDemand on_demand;
  for (const PlannedInput& input : planned.inputs) on_demand.AddInput(InputName(input));
  std::map<std::string, fs::path> later;  // by name
  for (const PlannedInput& input : planned.inputs) {
    const fs::path output = fs::path(earlier.at(input.task.value()).output_dir) / input.output.str();
    on_demand(InputName(input)) ? (void)later.emplace(InputName(input), output) : bring(output, InputName(input));
  }
  for (const int file : *planned.scene_files) {
    if (on_demand(std::string(kSceneFolder) + "/" + scene.files.at(file))) continue;
    bring(scene.files.at(file) == kClassifierFile ? fs::path(settings.classifier)
                                                  : fs::path(scene.folder) / scene.files[file],
          std::string(kSceneFolder) + "/" + scene.files[file]);
  }
  for (const PlannedTask::ViewFile& file : *planned.view_files) {
    const fs::path target = fs::path(scene.folder) / scene.files.at(file.file);
    on_demand(ViewInputName(file)) ? (void)later.emplace(ViewInputName(file), target)
                                   : bring(target, ViewInputName(file));
  }
  TaskRequest request = {planned.kind, planned.parameters, input_dir, task.output_dir};
  request.fetch = [&](const std::vector<std::string>& paths) -> Status {
    for (const std::string& path : paths) {
      if (FileExists(path)) continue;
      const std::string name = fs::path(path).lexically_relative(input_dir).generic_string();
      const auto found = later.find(name);
      bring(found != later.end() ? found->second
                                 : fs::path(scene.folder) / fs::path(name).lexically_relative(kSceneFolder),
            name);
    }
    return absl::OkStatus();
  };
  TESSERA_ASSIGN_OR_RETURN(task.outcome, runner ? runner(request) : RunTask(request, TaskControl()));
  return task;
}

// Of the tiles that the tasks from `first` on cut, but for those whose cut is to fail.
StatusOr<std::vector<TileReads>> ReadsOf(const std::vector<LineTask>& tasks, size_t first,
                                         const std::vector<FailedTile>& quarantined, bool fine) {
  std::vector<TileReads> reads;
  for (size_t t = first; t < tasks.size(); ++t) {
    const PlannedTask& planned = tasks[t].planned;
    if (planned.kind != kCutKind) continue;
    TESSERA_ASSIGN_OR_RETURN(const std::string json, ReadFile(tasks[t].output_dir + "/" + kReadsFile));
    TESSERA_ASSIGN_OR_RETURN(const CutParameters parameters, ParseCutParameters(planned.parameters));
    TESSERA_ASSIGN_OR_RETURN(TileReads of_tile,
                             ParseTileReads(json, planned.tile, static_cast<int>(parameters.cores.size())));
    const FailedTile not_cut = {.tile = planned.tile, .kind = kCutKind, .fine = fine};
    if (std::find(quarantined.begin(), quarantined.end(), not_cut) == quarantined.end())
      reads.push_back(std::move(of_tile));
  }
  return reads;
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
  std::optional<FinePart> fine;
  const auto planned = [&] { return tasks.back().planned.kind.str(); };
  while (true) {
    const FinePart* const part = fine ? &*fine : nullptr;
    const size_t first = tasks.size();
    TESSERA_ASSIGN_OR_RETURN(const std::vector<PlannedTask> tiles,
                             PlanTiles(settings, survey, scene.files, nullptr, part));
    TESSERA_RETURN_IF_ERROR(run(tiles));
    if (planned() == kCutKind) {
      TESSERA_ASSIGN_OR_RETURN(const std::vector<TileReads> reads,
                               ReadsOf(tasks, first, quarantined, fine.has_value()));
      TESSERA_ASSIGN_OR_RETURN(const std::vector<PlannedTask> steps,
                               PlanSteps(settings, survey, scene.files, reads, nullptr, quarantined, part));
      TESSERA_RETURN_IF_ERROR(run(steps));
    }
    if (planned() != kSplitKind) return tasks;
    fine = FinePart{"", TaskId(static_cast<int>(tasks.size()) - 1), static_cast<int>(tasks.size())};
    for (size_t t = 0; t < tasks.size(); ++t) {
      fine->crops.merge(CropsByTile(tasks[t].planned, TaskId(static_cast<int>(t))));
    }
    TESSERA_ASSIGN_OR_RETURN(fine->survey, ReadFile(tasks.back().output_dir + "/" + kSurveyFile));
    for (const FailedTile& tile : quarantined) {
      if (!tile.fine) fine->left_out.push_back(tile.tile);
    }
  }
}

}  // namespace tessera
