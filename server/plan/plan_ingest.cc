#include <numeric>

#include "server/plan/graph.h"
#include "server/plan/update_tasks.h"

namespace tessera {

std::string InputName(const PlannedInput& input) {
  return input.tile < 0 ? input.output.str() : TileInputName(input.tile, input.output);
}

IngestParameters IngestParametersOf(const JobSettings& settings) {
  return {settings.method_settings.partners, settings.method_settings.views_per_direction, Classifies(settings),
          settings.classifier == kDefaultClassifier};
}

StatusOr<PlannedTask> PlanIngest(const JobSettings& settings, const std::vector<std::string>& scene_files) {
  TESSERA_RETURN_IF_ERROR(CheckJobSettings(settings));
  if (scene_files.empty()) return absl::InvalidArgumentError("the scene has no files");
  PlannedTask task;
  task.kind = task.name = kIngestKind;
  task.parameters = ToJson(IngestParametersOf(settings));
  task.cost = kIngestSecondsPerFile * static_cast<double>(scene_files.size());
  std::vector<int>& files = task.scene_files.Edit();
  files.resize(scene_files.size());
  std::iota(files.begin(), files.end(), 0);
  return task;
}

}  // namespace tessera
