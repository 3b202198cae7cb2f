// COLMAP's binary files, as three or five frames: cameras, images, points, rigs, frames.
#pragma once

#include <string>

#include "tests/fuzz/colmap/colmap_promises.h"

namespace tessera {

inline bool RunColmapBinaryTarget(const std::string& bytes) {
  return RunColmapTarget(bytes, ParseColmapBinary, ParseColmapFramesBinary);
}

}  // namespace tessera
