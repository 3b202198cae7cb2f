#include "tests/support/in_process_line.h"

#include <filesystem>

#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "common/tile/task_parameters.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

StatusOr<LineTask> RunPlanned(const PlannedTask& planned, const std::string& scene_dir, const std::string& folder,
                              const std::vector<LineTask>& earlier, const TaskRunner& runner) {
  LineTask task = {planned, folder + "/out", {}};
  const std::string input_dir = folder + "/in";
  TESSERA_RETURN_IF_ERROR(EnsureFolder(input_dir));
  TESSERA_RETURN_IF_ERROR(EnsureFolder(task.output_dir));
  std::vector<PlannedInput> inputs = planned.inputs;
  if (planned.scene_inputs_of >= 0) {
    for (const PlannedInput& input : earlier.at(planned.scene_inputs_of).planned.inputs) {
      if (!input.scene_file.empty()) inputs.push_back(input);
    }
  }
  for (const PlannedInput& input : inputs) {
    const fs::path link = fs::path(input_dir) / input.name;
    const fs::path target = input.task < 0 ? fs::path(scene_dir) / input.scene_file
                                           : fs::path(earlier.at(input.task).output_dir) / input.output;
    fs::create_directories(link.parent_path());
    fs::create_symlink(fs::absolute(target), link);
  }
  const TaskRequest request = {planned.kind, planned.parameters, input_dir, task.output_dir};
  TESSERA_ASSIGN_OR_RETURN(task.outcome, runner ? runner(request) : RunTask(request, TaskControl()));
  return task;
}

}  // namespace

StatusOr<std::vector<LineTask>> RunLine(const std::string& scene_dir, const std::string& work_dir,
                                        const JobSettings& settings, const TaskRunner& runner) {
  Warnings warnings;
  TESSERA_ASSIGN_OR_RETURN(const SceneDescription scene, LoadScene(scene_dir, &warnings));
  TESSERA_ASSIGN_OR_RETURN(const PlannedTask ingest, PlanIngest(settings, scene.files));
  std::vector<LineTask> tasks;
  TESSERA_ASSIGN_OR_RETURN(LineTask first, RunPlanned(ingest, scene.folder, work_dir + "/0", tasks, runner));
  tasks.push_back(std::move(first));
  TESSERA_ASSIGN_OR_RETURN(const std::string survey, ReadFile(tasks[0].output_dir + "/" + kSurveyFile));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<PlannedTask> planned, PlanTiles(settings, survey));
  for (const PlannedTask& task : planned) {
    const std::string folder = work_dir + "/" + std::to_string(tasks.size());
    TESSERA_ASSIGN_OR_RETURN(LineTask done, RunPlanned(task, scene.folder, folder, tasks, runner));
    tasks.push_back(std::move(done));
  }
  return tasks;
}

}  // namespace tessera
