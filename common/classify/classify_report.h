// Reports of a classification, as text and as JSON.
#pragma once

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
  const TrainedClassifier* trained = nullptr;  // only for "annotations", else null
  const Annotations* annotations = nullptr;    // only for "annotations", else null
  const ClassifiedScene* classified = nullptr;
  double gsd_m = 0;
  std::optional<double> model_gsd_m;  // of a loaded model
  double train_cpu_s = 0, classify_cpu_s = 0;
  Warnings warnings;
};

// The images without annotation, sorted by the expected gain of annotating them, best first.
std::vector<size_t> NextToAnnotate(const ClassifiedScene& classified);

std::string ClassifyText(const ClassifyReport& report);  // ends with a newline
std::string ClassifyJson(const ClassifyReport& report);

}  // namespace tessera
