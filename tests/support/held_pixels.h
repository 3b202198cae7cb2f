// A view's pixels in memory.
#ifndef TESSERA_TESTS_SUPPORT_HELD_PIXELS_H_
#define TESSERA_TESTS_SUPPORT_HELD_PIXELS_H_

#include <memory>
#include <utility>

#include "worker/refine/view_pixels.h"

namespace tessera {

class HeldPixels : public ViewPixels {
 public:
  explicit HeldPixels(FloatImage luminance, FloatImage likelihoods = FloatImage())
      : luminance_(std::move(luminance)), likelihoods_(std::move(likelihoods)) {}
  int width() const override { return luminance_.width; }
  int height() const override { return luminance_.height; }
  StatusOr<FloatImage> Luminance() const override { return luminance_; }
  bool has_likelihoods() const override { return !likelihoods_.empty(); }
  StatusOr<FloatImage> Likelihoods() const override { return likelihoods_; }

 private:
  FloatImage luminance_, likelihoods_;
};

}  // namespace tessera

#endif  // TESSERA_TESTS_SUPPORT_HELD_PIXELS_H_
