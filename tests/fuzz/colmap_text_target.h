// COLMAP's text files, as three frames: cameras, images, points.
#pragma once

#include <string>

#include "tests/fuzz/colmap_promises.h"

namespace tessera {

inline bool RunColmapTextTarget(const std::string& bytes) { return RunColmapTarget(bytes, ParseColmapText); }

}  // namespace tessera
