// Training of a classifier from annotated images, with spatial cross-validation.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/classify/annotations.h"
#include "common/classify/boosted_trees.h"
#include "common/classify/mesh_surface.h"
#include "common/classify/model.h"
#include "common/classify/score_calibration.h"
#include "common/classify/spatial_folds.h"
#include "common/scene/scene.h"

namespace tessera {

struct TrainingOptions {
  BoostingOptions boosting;
  int64_t samples = 60000;  // maximum number of training pixels
  uint64_t seed = 1;
};

// Calibration statistics on held-out pixels, before and after temperature scaling.
struct HeldOutStatistics {
  double temperature = 1;
  double log_loss_before = 0, log_loss_after = 0;
  double calibration_error_before = 0, calibration_error_after = 0;
};

struct TrainedClassifier {
  ClassifierModel model;
  SpatialFolds spatial_folds;
  std::vector<std::array<BoostedTrees, 2>> folds;  // by fold, then Evidence: trained on all other folds
  std::array<HeldOutStatistics, 2> held_out;       // by Evidence
  int64_t samples = 0;
};

// Draws pixels from all annotated images, each class in proportion to the square root of its share, and reads each
// image once. INVALID_ARGUMENT if all annotated pixels lie in one cell; errors of reading images, or CANCELLED. The
// result does not depend on the number of threads.
StatusOr<TrainedClassifier> TrainClassifier(const SceneDescription& scene, const Annotations& annotations,
                                            const MeshSurface& surface, double gsd_m, const TrainingOptions& options,
                                            const TaskControl& control);

}  // namespace tessera
