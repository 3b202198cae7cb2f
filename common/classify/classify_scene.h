// Likelihoods of all images of a scene.
#ifndef TESSERA_COMMON_CLASSIFY_CLASSIFY_SCENE_H_
#define TESSERA_COMMON_CLASSIFY_CLASSIFY_SCENE_H_

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

// One of the first two; `trained` and `annotations` go together. All must outlive the call.
struct ClassifierInUse {
  const ClassifierModel* model = nullptr;      // classes in the order of `class_of_scene`
  const DefaultRule* rule = nullptr;           // writes Evidence::kGeometry alone
  const TrainedClassifier* trained = nullptr;  // the model's: annotated pixels are classified without their place
  const Annotations* annotations = nullptr;
  std::vector<int> class_of_scene;  // of the model for each of the scene; empty: the same order
};

struct ViewFigures {
  bool annotated = false;
  double entropy = 0;    // mean over its pixels, of the likelihoods with the mesh, as a share of the greatest
  double new_share = 1;  // of its pixels, that show no annotated place
  double gain = 0;       // mean over pixels of entropy, those of annotated places counted for a quarter
};

struct ClassifiedScene {
  std::vector<ViewFigures> views;
  std::array<ConfusionMatrix, 2> held_out;  // by Evidence, of annotated pixels; empty without annotations
  int64_t pixels = 0;
};

// The likelihoods of one view, those that know the mesh: a plane a class, 1 to 255, in the image's own frame, about 130
// bytes a pixel at work; without a surface by appearance alone. Rows are shared out among threads; the same bytes for
// any number of them. Errors of reading.
StatusOr<ByteImage> ClassifyView(const SceneDescription& scene, size_t view, const MeshSurface* surface,
                                 const ClassifierInUse& classifier);

// Writes FOLDER/appearance/STEM.tif and FOLDER/geometry/STEM.tif for each image: a page a class, 8 bits, in the image's
// own frame. Images are shared out among threads, about 130 bytes a pixel each; the same bytes for any number of them.
// Errors of reading and writing, or CANCELLED; what is written until then stays.
StatusOr<ClassifiedScene> ClassifyScene(const SceneDescription& scene, const MeshSurface& surface,
                                        const ClassifierInUse& classifier, const std::string& folder,
                                        const TaskControl& control);

}  // namespace tessera

#endif  // TESSERA_COMMON_CLASSIFY_CLASSIFY_SCENE_H_
