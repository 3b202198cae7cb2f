// NumPy's NPY files, versions 1 to 3: https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html
#ifndef TESSERA_COMMON_IMAGING_NPY_H_
#define TESSERA_COMMON_IMAGING_NPY_H_

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/raster.h"

namespace tessera {

// A three-dimensional array (channels x height x width) of uint8, float16 or float32 in C order, little-endian. `name`
// stands for the file in messages, which give byte offsets. The shape is compared with the length of `bytes` before
// anything is allocated.
StatusOr<FloatImage> ParseNpy(const std::vector<uint8_t>& bytes, const std::string& name);

// Such an array where it lies in a file's bytes, which must outlive it.
struct NpyArray {
  int channels = 0, height = 0, width = 0;
  int value_bytes = 0;
  const uint8_t* values = nullptr;
};
StatusOr<NpyArray> FindNpyArray(const std::vector<uint8_t>& bytes, const std::string& name);
// A part of all its channels.
FloatImage NpyPart(const NpyArray& array, const ImagePart& part);

// Value of an IEEE 754 half-precision number.
float FloatFromHalf(uint16_t half);

}  // namespace tessera

#endif  // TESSERA_COMMON_IMAGING_NPY_H_
