// Classification of the images of a scene: computes likelihoods.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/classify/annotations.h"
#include "common/classify/default_rule.h"
#include "common/classify/mesh_surface.h"
#include "common/classify/model.h"
#include "common/classify/training.h"
#include "common/evaluate/confusion.h"
#include "common/scene/scene.h"

namespace tessera {

// The classifier to use: either `model` or `rule`. `trained` and `annotations` are set together, with `model`. All
// pointers must outlive the call.
struct ClassifierSelection {
  const ClassifierModel* model = nullptr;
  const DefaultRule* rule = nullptr;  // writes only Evidence::kGeometry
  const TrainedClassifier* trained =
      nullptr;  // classifies annotated areas with the trees of the fold in which they were held out
  const Annotations* annotations = nullptr;
  std::vector<int> class_of_scene;  // model class of each scene class; empty: equal order
};

struct ViewStatistics {
  bool annotated = false;
  double entropy = 0;    // mean entropy of the pixels' kGeometry likelihoods, relative to the maximum
  double new_share = 1;  // share of its pixels outside annotated areas
  double gain = 0;       // mean entropy, where pixels in annotated areas have weight 1/4
};

struct ClassifiedScene {
  std::vector<ViewStatistics> views;
  std::array<ConfusionMatrix, 2> held_out;  // of annotated pixels, by Evidence; empty without annotations
  int64_t pixels = 0;
};

// The likelihoods of one view (Evidence::kGeometry; kAppearance with a model and a null `surface`): one plane per
// class, values 1 to 255, in the distorted image. Needs about 130 bytes per pixel. Uses all threads; the result does
// not depend on their number. Errors of reading the image.
StatusOr<ByteImage> ClassifyView(const SceneDescription& scene, size_t view, const MeshSurface* surface,
                                 const ClassifierSelection& classifier);

// Writes FOLDER/appearance/STEM.tif and FOLDER/geometry/STEM.tif for each image: one 8-bit page per class, in the
// distorted image. Processes images in parallel, about 130 bytes per pixel each; the result does not depend on the
// number of threads. Errors of reading and writing, or CANCELLED; files written before an error stay.
StatusOr<ClassifiedScene> ClassifyScene(const SceneDescription& scene, const MeshSurface& surface,
                                        const ClassifierSelection& classifier, const std::string& folder,
                                        const TaskControl& control);

}  // namespace tessera
