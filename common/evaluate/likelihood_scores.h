// Accuracy of the likeliest class of each pixel and, for comparison, of the rendered labels of a mesh.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/evaluate/confusion.h"
#include "common/evaluate/evaluator.h"
#include "common/imaging/raster.h"
#include "common/scene/scene.h"

namespace tessera {

// Undistorted likelihoods of a view; their resolution is at most the image's.
using LikelihoodSource = std::function<StatusOr<FloatImage>(size_t view)>;

// Rendered labels of a mesh in a view, undistorted, in the image's size; 255: the pixel is not compared.
using LabelRendering = std::function<LabelImage(size_t view)>;

struct LikelihoodConfusion {
  std::string view;             // name
  ConfusionMatrix likelihoods;  // of the likeliest classes
  ConfusionMatrix mesh;         // of the rendered labels, over the same pixels; empty: none
};

// Confusion matrices of the views' likeliest classes (the first of equal ones) against their truth, over the pixels of
// the undistorted image, without views of which no pixel is compared. With `rendering`, pixels that it sets to 255 are
// skipped, and its labels are compared too. Sources are called from any thread, at most once per view.
StatusOr<std::vector<LikelihoodConfusion>> ConfuseLikelihoods(const std::vector<SceneView>& views, int classes,
                                                              const TruthLabelSource& truth,
                                                              const LikelihoodSource& likelihoods,
                                                              const LabelRendering& rendering = nullptr);

}  // namespace tessera
