#include "server/plan/planned_task.h"

#include <algorithm>

namespace tessera {

std::string InputName(const PlannedInput& input) {
  return input.tile < 0 ? input.output.str() : TileInputName(input.tile, input.output);
}

std::string ViewInputName(const PlannedTask::ViewFile& file) {
  return file.mask ? ViewMaskName(file.view) : ViewFileName(file.view, file.likelihoods);
}

void SetCost(const Prediction& cost, PlannedTask* task) {
  task->cost = cost.core_seconds;
  task->peak_bytes = cost.peak_bytes;
  task->stored_bytes = cost.stored_bytes;
}

void SetReported(const Survey& survey, PublishParameters* parameters) {
  constexpr size_t kMostBytes = 1 << 20;  // the parameters are part of records and leases
  parameters->scene_name = survey.scene_name;
  parameters->warnings = survey.warnings;
  parameters->fit = survey.fit;
  parameters->skipped_images = survey.skipped_images;
  if (survey.source.size() <= kMostBytes) parameters->source = survey.source;
  size_t bytes = 0;
  for (const SceneView& view : survey.views) bytes += view.name.size();
  for (size_t v = 0; bytes <= kMostBytes && v < survey.views.size(); ++v) {
    parameters->view_names.push_back(survey.views[v].name);
  }
}

StatusOr<std::vector<std::vector<PlannedTask::ViewFile>>> FilesOfViews(const Survey& survey,
                                                                       const std::vector<std::string>& files) {
  std::vector<std::vector<PlannedTask::ViewFile>> found(survey.views.size());
  for (size_t v = 0; v < survey.views.size(); ++v) {
    const SceneView& view = survey.views[v];
    for (const std::string* path : {&view.image_path, &view.mask_path, &view.likelihood_path}) {
      if (path->empty()) continue;
      const auto it = std::lower_bound(files.begin(), files.end(), *path);
      if (it == files.end() || *it != *path) return absl::NotFoundError("the scene has no file " + *path);
      found[v].push_back({static_cast<int>(it - files.begin()), static_cast<int32_t>(v), path == &view.likelihood_path,
                          path == &view.mask_path});
    }
  }
  return found;
}

}  // namespace tessera
