// From annotated images to a classifier, tested by folds over places.
#ifndef TESSERA_COMMON_CLASSIFY_TRAINING_H_
#define TESSERA_COMMON_CLASSIFY_TRAINING_H_

#include <array>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/classify/annotations.h"
#include "common/classify/boosted_trees.h"
#include "common/classify/calibration.h"
#include "common/classify/mesh_surface.h"
#include "common/classify/model.h"
#include "common/classify/places.h"
#include "common/scene/scene.h"

namespace tessera {

struct TrainingOptions {
  BoostingOptions boosting;
  int64_t samples = 60000;      // pixels learnt from, at most
  double class_balance = 0.25;  // classes' weight: their share of the annotated pixels to this power
  int folds = 4;
  uint64_t seed = 1;
};

// What tells how far a likelihood can be trusted, from pixels that were held out.
struct HeldOutFigures {
  double temperature = 1;
  double log_loss_before = 0, log_loss_after = 0;
  double calibration_error_before = 0, calibration_error_after = 0;
};

struct TrainedClassifier {
  ClassifierModel model;
  PlaceFolds places;
  std::vector<std::array<BoostedTrees, 2>> folds;  // by fold: learnt from the other folds; then by Evidence
  std::array<HeldOutFigures, 2> held_out;          // by Evidence
  int64_t samples = 0;
};

// Pixels are drawn from all annotated images, each class by the root of its share. Reads each annotated image once.
// INVALID_ARGUMENT if all annotated pixels lie at one place; otherwise errors of reading images, or CANCELLED. The same
// bytes for any number of threads.
StatusOr<TrainedClassifier> TrainClassifier(const SceneDescription& scene, const Annotations& annotations,
                                            const MeshSurface& surface, double gsd_m, const TrainingOptions& options,
                                            const TaskControl& control);

}  // namespace tessera

#endif  // TESSERA_COMMON_CLASSIFY_TRAINING_H_
