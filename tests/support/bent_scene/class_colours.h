// The colours of the four known classes.
#pragma once

#include <array>
#include <cstdint>

#include "common/imaging/raster.h"

namespace tessera::bent {

inline constexpr std::array<std::array<uint8_t, 3>, 4> kClassColours = {
    {{128, 128, 128}, {128, 0, 128}, {230, 190, 30}, {40, 150, 50}}};

// RGB of class ids; white for other ids.
inline ByteImage InClassColours(const ByteImage& ids) {
  ByteImage rgb(ids.width, ids.height, 3, 255);
  for (size_t i = 0; i < ids.data.size(); ++i) {
    if (ids.data[i] >= kClassColours.size()) continue;
    for (int c = 0; c < 3; ++c) rgb.plane(c)[i] = kClassColours[ids.data[i]][c];
  }
  return rgb;
}

}  // namespace tessera::bent
