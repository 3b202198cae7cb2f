// COLMAP's text files, as three or five frames: cameras, images, points, rigs, frames.
#pragma once

#include <string>

#include "tests/fuzz/colmap/colmap_promises.h"

namespace tessera {

inline bool RunColmapTextTarget(const std::string& bytes) {
  return RunColmapTarget(bytes, ParseColmapText, ParseColmapFramesText);
}

}  // namespace tessera
