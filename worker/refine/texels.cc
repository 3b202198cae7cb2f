#include "worker/refine/texels.h"

#include <cmath>
#include <vector>

#include "worker/refine/stored_texels.h"

namespace tessera {

uint16_t LuminanceCode(float luminance) {
  if (std::isnan(luminance)) return 0;
  return static_cast<uint16_t>(1.5f + std::clamp(luminance, 0.0f, 1.0f) * Texels::kLuminanceSteps);
}

uint8_t LikelihoodStep(float likelihood) {
  return static_cast<uint8_t>(std::clamp(likelihood, 0.0f, 1.0f) * Texels::kLikelihoodSteps + 0.5f);
}

Texels MakeTexels(const FloatImage& luminance, int x0, int y0) { return MakeTexels(luminance, {}, {}, x0, y0); }

Texels MakeTexels(const FloatImage& luminance, const FloatImage& likelihoods, const PixelMapping& mapping, int x0,
                  int y0) {
  std::vector<uint16_t> codes;
  for (const float value : luminance.data) codes.push_back(LuminanceCode(value));
  std::vector<uint8_t> steps;
  for (const float value : likelihoods.data) steps.push_back(LikelihoodStep(value));
  StoredTexels stored;
  static_cast<TexelShape&>(stored) =
      TexelShape::First({x0, y0, x0 + luminance.width, y0 + luminance.height},
                        likelihoods.empty() ? 0 : likelihoods.channels, likelihoods.width, likelihoods.height, mapping);
  stored.luminance = codes;
  stored.likelihoods = steps;
  Texels out;
  stored.Bring(stored.rect, &out);
  return out;
}

PixelMapping ScaleToSize(const FloatImage& luminance, const FloatImage& likelihoods) {
  PixelMapping mapping;
  mapping.scale_x = static_cast<double>(likelihoods.width) / std::max(luminance.width, 1);
  mapping.scale_y = static_cast<double>(likelihoods.height) / std::max(luminance.height, 1);
  return mapping;
}

}  // namespace tessera
