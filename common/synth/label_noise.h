// How classifiers fail: correlated blobs, confusions between particular classes, blurred borders.
#ifndef TESSERA_COMMON_SYNTH_LABEL_NOISE_H_
#define TESSERA_COMMON_SYNTH_LABEL_NOISE_H_

#include <cstdint>

#include "common/synth/render.h"

namespace tessera {

// Fixed for every city: what `tessera synth` aims at, and the ranges that it stays in.
inline constexpr double kStartAverageAccuracy = 0.84;       // .82 to .86
inline constexpr double kStartAreaSlack = 0.018;            // the most by which the accuracy by area exceeds that
inline constexpr double kLikelihoodArgmaxAccuracy = 0.875;  // .85 to .90

// The class that a weak classifier takes `label` for; `choice` in [0, 1) picks among the likely ones.
int32_t ConfusedClass(int32_t label, float choice);

struct LabelDoubt {
  float doubt;   // about standard normal; a classifier fails where it is above some threshold
  float choice;  // in [0, 1): the confusion that is made there
};

// Doubt about a place on the surface, blobs of some `scale_m` times 3 to 10.
LabelDoubt SurfaceDoubt(const Eigen::Vector3d& p, double scale_m, uint32_t seed);

// Doubt a pixel of one view: mostly the view's own, in part the surface's (the same roof fails in many views).
struct ViewDoubt {
  FloatImage doubt, choice;
};
ViewDoubt PixelDoubt(const CityPlan& plan, const RenderedView& view, uint64_t view_seed);

// Likelihoods, four planes of bytes, of a classifier that fails where the doubt exceeds `threshold`. Places where
// nothing is seen get even values.
ByteImage MakeLikelihoods(const RenderedView& view, const ViewDoubt& doubt, double threshold);

// Pixels whose largest likelihood names the true class, and pixels with a true class.
struct ArgmaxCount {
  int64_t right = 0, all = 0;
};
ArgmaxCount CountArgmax(const RenderedView& view, const ByteImage& likelihoods);

}  // namespace tessera

#endif  // TESSERA_COMMON_SYNTH_LABEL_NOISE_H_
