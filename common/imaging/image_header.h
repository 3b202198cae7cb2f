// Headers of photographs: JPEG, PNG and TIFF. The format is detected from the content, not from the name.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/image_io.h"

namespace tessera {

bool IsPng(const std::vector<uint8_t>& bytes);
bool IsJpeg(const std::vector<uint8_t>& bytes);
bool IsTiff(const std::vector<uint8_t>& bytes);

// What the header of an image says.
struct ImageHeader {
  ImageSize size;
  int bits = 8;           // per sample
  bool has_alpha = false;
  int orientation = 1;    // of the tag (EXIF, TIFF): 1 as stored, 2 to 8 turned or mirrored for display
};

// `bytes`: the file at `path` or its beginning. The size is 0 x 0 if a JPEG's frame header lies beyond `bytes`.
// INVALID_ARGUMENT for another format.
StatusOr<ImageHeader> HeaderOf(const std::string& path, const std::vector<uint8_t>& bytes);

// The header of the image at `path`. INVALID_ARGUMENT also without a size.
StatusOr<ImageHeader> ReadImageHeader(const std::string& path);

// Whether the image data of a JPEG ends with an end-of-image marker. Decoders fill the missing part of a truncated JPEG
// with grey without an error.
bool JpegEnds(const std::vector<uint8_t>& bytes);

}  // namespace tessera
