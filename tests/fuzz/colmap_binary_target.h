// COLMAP's binary files, as three frames: cameras, images, points.
#pragma once

#include <string>

#include "tests/fuzz/colmap_promises.h"

namespace tessera {

inline bool RunColmapBinaryTarget(const std::string& bytes) { return RunColmapTarget(bytes, ParseColmapBinary); }

}  // namespace tessera
