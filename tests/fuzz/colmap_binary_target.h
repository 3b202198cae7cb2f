// COLMAP's binary files, as three frames: cameras, images, points.
#ifndef TESSERA_TESTS_FUZZ_COLMAP_BINARY_TARGET_H_
#define TESSERA_TESTS_FUZZ_COLMAP_BINARY_TARGET_H_

#include <string>

#include "tests/fuzz/colmap_promises.h"

namespace tessera {

inline bool RunColmapBinaryTarget(const std::string& bytes) { return RunColmapTarget(bytes, ParseColmapBinary); }

}  // namespace tessera

#endif  // TESSERA_TESTS_FUZZ_COLMAP_BINARY_TARGET_H_
