// A classification as people read it and as programs do.
#ifndef TESSERA_COMMON_CLASSIFY_CLASSIFY_REPORT_H_
#define TESSERA_COMMON_CLASSIFY_CLASSIFY_REPORT_H_

#include <optional>
#include <string>
#include <vector>

#include "common/classify/classify_scene.h"
#include "common/classify/training.h"
#include "common/scene/scene.h"

namespace tessera {

struct ClassifyReport {
  const SceneDescription* scene = nullptr;
  std::string source;                          // "annotations", "model" or "default"
  const TrainedClassifier* trained = nullptr;  // null but for "annotations"
  const Annotations* annotations = nullptr;    // with it
  const ClassifiedScene* classified = nullptr;
  double gsd_m = 0;
  std::optional<double> model_gsd_m;  // of a model that was read
  double train_cpu_s = 0, classify_cpu_s = 0;
  Warnings warnings;
};

// The images that gain most from an annotation, best first; without those that have one.
std::vector<size_t> NextToAnnotate(const ClassifiedScene& classified);

std::string ClassifyText(const ClassifyReport& report);  // ends with a newline
std::string ClassifyJson(const ClassifyReport& report);

}  // namespace tessera

#endif  // TESSERA_COMMON_CLASSIFY_CLASSIFY_REPORT_H_
