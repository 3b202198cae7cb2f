#include <nlohmann/json.hpp>

#include "common/job/task_parameters.h"
#include "worker/tasks/step_task.h"
#include "worker/tasks/task_functions.h"
#include "worker/tile/measure_tile.h"
#include "worker/tile/methods.h"
#include "worker/tile/tile_fit.h"

namespace tessera {

StatusOr<TaskOutcome> RunMeasure(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(StepTask task, OpenStepTask(request, 0, 0));
  const std::vector<std::string> crops = CropsOf(request, task.work->package().tile);
  TESSERA_ASSIGN_OR_RETURN(TileImages* const images, task.work->Images(crops, task.options));
  const double seconds_opening = SecondsSince(clock, start_us);
  StepSums sums;
  TESSERA_RETURN_IF_ERROR(
      Measure(*task.work, *images, task.snapshot, task.at, task.options, PartOf(control, 0, 0.85), clock, &sums));
  images->data_term.ReleaseBuffers();
  const StepParameters& p = task.parameters;
  if (IsLastOfMoves({p.rounds, p.method, p.settings}, task.work->package(), p.step)) {
    TESSERA_ASSIGN_OR_RETURN(const TileFit fit,
                             CompareFit(*task.work, *images, task.snapshot.positions, PartOf(control, 0.85, 0.95)));
    sums.fit = ToJson(fit);
  }
  const double seconds_loading = seconds_opening + sums.seconds_loading;
  nlohmann::json stats;
  if (task.at.labels()) {
    stats["seconds_labels"] = SecondsSince(clock, start_us) - seconds_loading;
  } else if (task.work->package().has_pairs) {
    const PhotoSums& photo = sums.derivatives.photo;
    stats["seconds_visibility"] = photo.seconds_visibility;
    stats["seconds_data"] = photo.seconds_photo;
    stats["warped_pixels"] = photo.warped_pixels;
  }
  control.Report(0.95, "writing sums");
  TESSERA_RETURN_IF_ERROR(WriteTileSums(OutputPath(request, kSumsFile), CoreSums(*task.work, sums)));
  // Solve reads the same states.
  task.work->kept_snapshot().Keep(std::move(task.states_key), std::move(task.snapshot));
  TaskOutcome outcome;
  outcome.outputs = {kSumsFile};
  stats["seconds_loading"] = seconds_loading;
  stats["seconds"] = SecondsSince(clock, start_us);
  outcome.stats = stats.dump();
  return outcome;
}

}  // namespace tessera
