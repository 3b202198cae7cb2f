#include "tests/bench/accuracy/scene_runner.h"

#include <ctime>
#include <filesystem>

#include "absl/strings/str_cat.h"
#include "common/job/task_parameters.h"
#include "common/meshio/mesh_format.h"
#include "common/storage/files.h"

namespace tessera {

namespace fs = std::filesystem;

double CpuSeconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

StatusOr<TriangleMesh> ReadLocalMesh(const std::string& path, const Frame& frame) {
  TESSERA_ASSIGN_OR_RETURN(MeshContent content, ReadMesh(path));
  for (Eigen::Vector3d& v : content.mesh.vertices) v = frame.LocalFromScene(v);
  return std::move(content.mesh);
}

double SceneRunner::Result::all_cpu_s() const {
  double sum = 0;
  for (const auto& [kind, seconds] : cpu_s) sum += seconds;
  return sum;
}

StatusOr<SceneRunner::Result> SceneRunner::Run(const std::string& name, const JobSettings& settings) {
  const std::string folder = absl::StrCat(work_folder_, "/", name);
  TESSERA_RETURN_IF_ERROR(RemoveTree(folder));
  Result result;
  const auto runner = [&](const TaskRequest& request) { return RunShared(request, &result.cpu_s); };
  TESSERA_ASSIGN_OR_RETURN(const std::vector<LineTask> tasks, RunLine(scene_folder_, folder, settings, runner));
  const std::string mesh_path = absl::StrCat(work_folder_, "/", name, ".ply");
  fs::rename(fs::path(tasks.back().output_dir) / kMeshFile, mesh_path);
  fs::copy_file(fs::path(CityTaskOf(tasks).output_dir) / kCityFile, fs::path(work_folder_) / kCityFile,
                fs::copy_options::overwrite_existing);
  for (const LineTask& task : tasks) result.tasks.push_back(task.planned);
  TESSERA_ASSIGN_OR_RETURN(result.mesh, ReadLocalMesh(mesh_path, frame_));
  TESSERA_RETURN_IF_ERROR(RemoveTree(folder));
  return result;
}

StatusOr<City> SceneRunner::Start() const { return ReadCity(absl::StrCat(work_folder_, "/", kCityFile)); }

StatusOr<Survey> SceneRunner::IngestedSurvey() const {
  TESSERA_ASSIGN_OR_RETURN(const std::string json, ReadFile(absl::StrCat(ingested_, "/", kSurveyFile)));
  return ParseSurvey(json);
}

StatusOr<TaskOutcome> SceneRunner::RunShared(const TaskRequest& request, std::map<std::string, double>* cpu_s) {
  // A cut reads what the last ingest made, or the city after the second split, which differs between runs.
  const auto reads_ingested = [&] {
    const fs::path city = fs::path(ingested_) / kCityFile;
    return fs::exists(city) && fs::equivalent(fs::path(request.input_dir) / kCityFile, city);
  };
  const bool shareable = request.kind == "ingest" || (request.kind == "cut" && reads_ingested());
  const std::string key = absl::StrCat(request.kind, request.kind == "cut" ? ingested_ : "", request.parameters);
  auto known = shared_.find(key);
  if (!shareable || known == shared_.end()) {
    TaskRequest own = request;
    if (shareable) {
      own.output_dir = absl::StrCat(work_folder_, "/shared/", shared_.size());
      TESSERA_RETURN_IF_ERROR(RemoveTree(own.output_dir));
      TESSERA_RETURN_IF_ERROR(EnsureFolder(own.output_dir));
    }
    const double start_s = CpuSeconds();
    TESSERA_ASSIGN_OR_RETURN(TaskOutcome outcome, RunTask(own, TaskControl()));
    const double used_s = CpuSeconds() - start_s;
    if (!shareable) {
      (*cpu_s)[request.kind] += used_s;
      return outcome;
    }
    known = shared_.emplace(key, Shared{own.output_dir, std::move(outcome), used_s}).first;
  }
  (*cpu_s)[request.kind] += known->second.cpu_s;
  for (const std::string& name : known->second.outcome.outputs) {
    fs::create_symlink(fs::absolute(fs::path(known->second.folder) / name), fs::path(request.output_dir) / name);
  }
  if (request.kind == kIngestKind) ingested_ = known->second.folder;
  return known->second.outcome;
}

}  // namespace tessera
