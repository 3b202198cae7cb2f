// COLMAP's text files, as three frames: cameras, images, points.
#ifndef TESSERA_TESTS_FUZZ_COLMAP_TEXT_TARGET_H_
#define TESSERA_TESTS_FUZZ_COLMAP_TEXT_TARGET_H_

#include <string>

#include "tests/fuzz/colmap_promises.h"

namespace tessera {

inline bool RunColmapTextTarget(const std::string& bytes) { return RunColmapTarget(bytes, ParseColmapText); }

}  // namespace tessera

#endif  // TESSERA_TESTS_FUZZ_COLMAP_TEXT_TARGET_H_
