// Simulated errors of classifiers: correlated blobs, confusions between certain classes, blurred borders.
#pragma once

#include <cstdint>

#include "common/synth/photos/render.h"

namespace tessera {

// Target accuracies of `tessera synth` for all cities, and the ranges of the results.
inline constexpr double kStartAverageAccuracy = 0.84;       // range 0.82 to 0.86
inline constexpr double kStartAreaSlack = 0.018;            // largest excess of the accuracy by area
inline constexpr double kLikelihoodArgmaxAccuracy = 0.875;  // range 0.85 to 0.90

// The class with which a weak classifier confuses `label`; `choice` in [0, 1) selects among the likely ones.
int32_t ConfusedClass(int32_t label, float choice);

struct LabelDoubt {
  float doubt;   // approximately standard normal; the classifier errs where it exceeds a threshold
  float choice;  // in [0, 1): selects the confused class
};

// Doubt at a point of the surface, with blobs of 3 to 10 times `scale_m`.
LabelDoubt SurfaceDoubt(const Eigen::Vector3d& p, double scale_m, uint32_t seed);

// Doubt per pixel of one view: mostly specific to the view, in part that of the surface, so that the same surface is
// misclassified in several views.
struct ViewDoubt {
  FloatImage doubt, choice;
};
ViewDoubt PixelDoubt(const CityPlan& plan, const RenderedView& view, uint64_t view_seed);

// Likelihoods (four planes of bytes) of a classifier that errs where the doubt exceeds `threshold`. Uniform where no
// surface is visible.
ByteImage MakeLikelihoods(const RenderedView& view, const ViewDoubt& doubt, double threshold);

// Pixels whose likeliest class is correct, and pixels with a true class.
struct ArgmaxCount {
  int64_t right = 0, all = 0;
};
ArgmaxCount CountArgmax(const RenderedView& view, const ByteImage& likelihoods);

}  // namespace tessera
