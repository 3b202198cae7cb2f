// How often the likeliest class of a pixel is the true one.
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

// Confusion of each view's likeliest classes (the first of equal ones) with its truth, over the undistorted image's
// pixels; empty where the view has no truth. Both sources are called from any thread, once a view at most.
StatusOr<std::vector<ConfusionMatrix>> ConfuseLikelihoods(const std::vector<LensModel>& lenses, int classes,
                                                          const TruthLabelSource& truth,
                                                          const LikelihoodSource& likelihoods);

}  // namespace tessera

#endif  // TESSERA_COMMON_EVALUATE_LIKELIHOOD_SCORES_H_
