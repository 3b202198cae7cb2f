// NumPy's NPY files, versions 1 to 3: https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/raster.h"

namespace tessera {

// An array inside a file's bytes, which must outlive it, as planes: channels x height x width. Of a two-dimensional
// array, height x width, `channels` is 1.
struct NpyArray {
  int channels = 0, height = 0, width = 0;
  int64_t plane_stride = 0, row_stride = 0, column_stride = 0;  // distances of neighbours, in values
  int axes = 3;                                                 // in the file, without a leading axis of length 1 of 4
  char kind = 'u';                                              // 'u': unsigned or bool, 'i': signed, 'f': float
  int value_bytes = 0;
  bool big_endian = false;
  const uint8_t* values = nullptr;
};

// Finds the array of whole numbers (1 to 8 bytes), bools, float16, float32 or float64, in C or Fortran order and either
// byte order. Two or three axes; four if the first has length 1. Errors name the file (`name`) and the byte offset.
// Checks the shape against the length of the file, `file_bytes` (none: bytes.size()). If `bytes` is only the file's
// beginning, with the whole header, the values must not be read.
StatusOr<NpyArray> FindNpyArray(const std::vector<uint8_t>& bytes, const std::string& name,
                                std::optional<size_t> file_bytes = {});

// The array with its axes taken as height x width x channels. It must have three.
NpyArray ChannelsLast(const NpyArray& array);

// Whether it holds one class id a pixel: whole numbers with two axes, or with a third of length 1 although there are
// several classes.
bool IsIdArray(const NpyArray& array, int classes);

// The values of `part` in all channels.
FloatImage NpyPart(const NpyArray& array, const ImagePart& part);

// The whole numbers of the first channel. Negative ones become 2^32 - 1, those above 2^31 - 1 become that.
Raster<uint32_t> NpyIds(const NpyArray& array);

}  // namespace tessera
