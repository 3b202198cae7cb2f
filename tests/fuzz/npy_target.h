// NumPy arrays.
#pragma once

#include <string>
#include <vector>

#include "common/imaging/npy.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// True if it was taken as an array.
inline bool RunNpyTarget(const std::string& bytes) {
  const std::vector<uint8_t> data(bytes.begin(), bytes.end());
  const StatusOr<NpyArray> array = FindNpyArray(data, "input");
  if (!array.ok()) {
    RequireRefusal(array.status());
    return false;
  }
  const FloatImage image = NpyPart(*array, {0, 0, array->width, array->height});
  Require(image.width > 0 && image.height > 0 && image.channels > 0, "an array has values");
  Require(image.data.size() == image.plane_size() * image.channels && image.data.size() <= data.size(),
          "an array is no larger than its file");
  return true;
}

}  // namespace tessera
