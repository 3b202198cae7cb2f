#include "worker/tasks/step_task.h"

#include <algorithm>
#include <cstring>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "worker/tasks/refined_surface.h"
#include "worker/tasks/task_functions.h"
#include "worker/tile/kept/kept_files.h"
#include "worker/tile/methods.h"

namespace tessera {

StatusOr<StepTask> OpenStepTask(const TaskRequest& request, uint8_t label_region, uint8_t iteration_region) {
  StepTask task;
  TESSERA_ASSIGN_OR_RETURN(task.parameters, ParseStepParameters(request.parameters));
  const StepParameters& p = task.parameters;
  TESSERA_ASSIGN_OR_RETURN(task.work,
                           TileWorkspace::Open(InputPath(request, kTileFile),
                                               absl::StrCat(p.method, "|", p.rounds, "|", ToJson(p.settings))));
  TESSERA_ASSIGN_OR_RETURN(task.options, MethodOptions({p.rounds, p.method, p.settings}, task.work->package()));
  const std::vector<TileStep> steps = TileStepsOf(RefineStepsOf(p.method, p.rounds, p.settings));
  if (p.step < 0 || p.step >= static_cast<int>(steps.size())) {
    return absl::InvalidArgumentError(
        absl::StrCat(request.kind, ": found step ", p.step, ", expected 0 to ", steps.size() - 1));
  }
  task.at = steps[p.step];
  std::vector<std::string> paths;
  for (const int tile : p.states) paths.push_back(InputPath(request, TileInputName(tile, kStateFile)));
  TESSERA_ASSIGN_OR_RETURN(const std::string contents, ContentsKey(paths));
  task.states_key = absl::StrCat(contents, absl::StrJoin(p.frozen, ","), ";", p.first_new_face);
  const uint8_t region = task.at.labels() ? label_region : iteration_region;
  if (auto kept = task.work->kept_snapshot().Take(task.states_key, region)) {
    task.snapshot = *std::move(kept);
  } else {
    TESSERA_ASSIGN_OR_RETURN(const StatesOfTiles files, OpenStates(request, p.states));
    std::vector<StateSpans> states;
    for (const auto& file : files) states.push_back(file->spans());
    TESSERA_ASSIGN_OR_RETURN(task.snapshot, task.work->Assemble(states, region, p.frozen, p.first_new_face));
  }
  if (p.continues_base) task.snapshot.report = "{}";
  return task;
}

std::vector<std::string> CropsOf(const TaskRequest& request, int tile) {
  std::vector<std::string> paths = {InputPath(request, kViewsFile)};
  std::string coarse = InputPath(request, TileInputName(tile, kViewsFile));
  if (FileExists(coarse)) paths.push_back(std::move(coarse));
  return paths;
}

void CountSeams(TileSnapshot* snapshot) {
  if (snapshot->compared == 0) return;
  nlohmann::json report = nlohmann::json::parse(snapshot->report);
  nlohmann::json& seams = report["seams"];
  if (seams.is_null()) seams = nlohmann::json::object();
  seams["samples"] = seams.value("samples", int64_t{0}) + snapshot->compared;
  seams["different"] = seams.value("different", int64_t{0}) + snapshot->different;
  seams["farthest_m"] = std::max(seams.value("farthest_m", 0.0), snapshot->farthest_m);
  snapshot->report = report.dump();
}

void CompareSample(const TilePackage& package, const SumsOfTiles& sums, TileSnapshot* snapshot) {
  const auto own = std::find_if(sums.begin(), sums.end(), [&](const auto& of) { return of->tile == package.tile; });
  if (own == sums.end()) return;
  const FaceSumsById& sample = (*own)->sample;
  const auto differ = [](const auto& a, size_t i, const auto& b, size_t j, size_t values) {
    if (a.empty() || b.empty()) return a.empty() != b.empty();
    return std::memcmp(&a[i * values], &b[j * values], values * sizeof(a[0])) != 0;
  };
  for (const auto& of_tile : sums) {
    if (of_tile == *own) continue;
    const TileSums& other = *of_tile;
    const auto classes = static_cast<size_t>(std::max((*own)->classes, 0));
    for (size_t i = 0; i < sample.face_ids.size(); ++i) {
      const auto found = std::lower_bound(other.face_ids.begin(), other.face_ids.end(), sample.face_ids[i]);
      if (found == other.face_ids.end() || *found != sample.face_ids[i]) continue;
      const auto j = static_cast<size_t>(found - other.face_ids.begin());
      ++snapshot->compared;
      if (!differ(sample.photo, i, other.photo, j, 1) && !differ(sample.pixels, i, other.pixels, j, 1) &&
          other.classes == (*own)->classes && !differ(sample.likelihoods, i, other.likelihoods, j, classes)) {
        continue;
      }
      ++snapshot->different;
      const auto face = std::find(package.face_ids.begin(), package.face_ids.end(), sample.face_ids[i]);
      if (snapshot->farthest_m > 0 || face == package.face_ids.end()) continue;
      snapshot->farthest_at = snapshot->positions[package.mesh.faces[face - package.face_ids.begin()][0]];
    }
  }
}

Warnings SeamWarnings(int tile, const TileSnapshot& snapshot) {
  if (snapshot.different == 0) return {};
  const Eigen::Vector3d& at = snapshot.farthest_at;
  return {absl::StrCat("near tile ", tile, ": neighbouring tiles differ at ", snapshot.different, " of ",
                       snapshot.compared, " vertices and faces, positions by ", snapshot.farthest_m, " m at most, at (",
                       at.x(), ", ", at.y(), ", ", at.z(),
                       ") of the local frame; this is a fault of the program, please report it")};
}

std::string FoldWarning(int tile, int64_t faces) {
  return absl::StrCat("near tile ", tile, ": ", faces,
                      " faces cut each other or turned against the start and could not be repaired");
}

StatusOr<SumsOfTiles> OpenSumsOf(const TaskRequest& request, const StepParameters& parameters) {
  SumsOfTiles sums;
  for (const int tile : parameters.sums) {
    TESSERA_ASSIGN_OR_RETURN(sums.emplace_back(), OpenSums(InputPath(request, TileInputName(tile, kSumsFile))));
  }
  return sums;
}

}  // namespace tessera
