// NumPy's NPY files, versions 1 to 3: https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/raster.h"

namespace tessera {

// A view of a three-dimensional array (channels x height x width) inside a file's bytes, which must outlive it.
struct NpyArray {
  int channels = 0, height = 0, width = 0;
  int value_bytes = 0;
  const uint8_t* values = nullptr;
};
// Finds the array of uint8, float16 or float32 in C order, little-endian. Errors name the file (`name`) and the byte
// offset. Checks the shape against the length of `bytes`.
StatusOr<NpyArray> FindNpyArray(const std::vector<uint8_t>& bytes, const std::string& name);
// The values of `part` in all channels.
FloatImage NpyPart(const NpyArray& array, const ImagePart& part);

}  // namespace tessera
