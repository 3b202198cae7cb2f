#include "worker/photo/texels.h"

#include <algorithm>
#include <cmath>

namespace tessera {

uint16_t LuminanceCode(float luminance) {
  if (std::isnan(luminance)) return 0;
  return static_cast<uint16_t>(1.5f + std::clamp(luminance, 0.0f, 1.0f) * Texels::kLuminanceSteps);
}

uint8_t LikelihoodStep(float likelihood) {
  return static_cast<uint8_t>(std::clamp(likelihood, 0.0f, 1.0f) * Texels::kLikelihoodSteps + 0.5f);
}

}  // namespace tessera
