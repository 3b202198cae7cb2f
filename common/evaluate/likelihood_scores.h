// Accuracy of the likeliest class of each pixel and, for comparison, of the rendered labels of a mesh.
#pragma once

#include <functional>
#include <vector>

#include "common/base/status.h"
#include "common/evaluate/confusion.h"
#include "common/evaluate/evaluator.h"
#include "common/imaging/camera.h"
#include "common/imaging/raster.h"

namespace tessera {

// Undistorted likelihoods of a view; their resolution is at most the image's.
using LikelihoodSource = std::function<StatusOr<FloatImage>(size_t view)>;

// Rendered labels of a mesh in a view, undistorted, in the image's size; 255: the pixel is not compared.
using LabelRendering = std::function<LabelImage(size_t view)>;

struct LikelihoodConfusion {
  ConfusionMatrix likelihoods;
  ConfusionMatrix mesh;  // over the same pixels
};

// Confusion matrices of each view's likeliest classes (the first of equal ones) against its truth, over the pixels of
// the undistorted image; empty if the view has no truth. With `rendering`, pixels that it sets to 255 are skipped, and
// its labels are compared too. Sources are called from any thread, at most once per view.
StatusOr<std::vector<LikelihoodConfusion>> ConfuseLikelihoods(const std::vector<LensModel>& lenses, int classes,
                                                              const TruthLabelSource& truth,
                                                              const LikelihoodSource& likelihoods,
                                                              const LabelRendering& rendering = nullptr);

}  // namespace tessera
