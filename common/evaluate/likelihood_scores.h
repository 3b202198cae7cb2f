// How often the likeliest class of a pixel is the true one, and how often that of a mesh where it shows.
#ifndef TESSERA_COMMON_EVALUATE_LIKELIHOOD_SCORES_H_
#define TESSERA_COMMON_EVALUATE_LIKELIHOOD_SCORES_H_

#include <functional>
#include <vector>

#include "common/base/status.h"
#include "common/evaluate/confusion.h"
#include "common/evaluate/evaluator.h"
#include "common/imaging/camera.h"
#include "common/imaging/raster.h"

namespace tessera {

// Undistorted likelihoods of a view, of any resolution not above the image's.
using LikelihoodSource = std::function<StatusOr<FloatImage>(size_t view)>;

// Labels of a mesh as a view shows it, undistorted, of the image's size; 255: a pixel that is not compared.
using LabelRendering = std::function<LabelImage(size_t view)>;

struct LikelihoodConfusion {
  ConfusionMatrix likelihoods;
  ConfusionMatrix mesh;  // over the same pixels
};

// Confusion of each view's likeliest classes (the first of equal ones) with its truth, over the undistorted image's
// pixels; empty where the view has no truth. With `rendering` only pixels that it does not leave out, and its labels
// beside them. Sources are called from any thread, once a view at most.
StatusOr<std::vector<LikelihoodConfusion>> ConfuseLikelihoods(const std::vector<LensModel>& lenses, int classes,
                                                              const TruthLabelSource& truth,
                                                              const LikelihoodSource& likelihoods,
                                                              const LabelRendering& rendering = nullptr);

}  // namespace tessera

#endif  // TESSERA_COMMON_EVALUATE_LIKELIHOOD_SCORES_H_
