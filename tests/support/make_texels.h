// Texels of images in memory.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "common/imaging/raster.h"
#include "worker/photo/stored_texels.h"
#include "worker/photo/texels.h"

namespace tessera {

// `luminance`: values in [0, 1] (others are clamped), NaN where invalid; its first pixel is (x0, y0) of the whole
// image. `likelihoods`: in [0, 1], a plane a class, of any resolution (StoredTexels::Bring), or empty; `mapping`: from
// the whole image.
inline Texels MakeTexels(const FloatImage& luminance, const FloatImage& likelihoods = FloatImage(),
                         const PixelMapping& mapping = {}, int x0 = 0, int y0 = 0) {
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
  stored.LoadWindow(stored.rect, &out);
  return out;
}

// Of a whole likelihood image that shows the same as the whole luminance image.
inline PixelMapping ScaleToSize(const FloatImage& luminance, const FloatImage& likelihoods) {
  PixelMapping mapping;
  mapping.scale_x = static_cast<double>(likelihoods.width) / std::max(luminance.width, 1);
  mapping.scale_y = static_cast<double>(likelihoods.height) / std::max(luminance.height, 1);
  return mapping;
}

}  // namespace tessera
