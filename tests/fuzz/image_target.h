// Photographs and label pictures: JPEG, PNG, TIFF.
#pragma once

#include <string>

#include "common/imaging/image_io.h"
#include "tests/fuzz/likelihoods_target.h"
#include "tests/fuzz/memory_file.h"

namespace tessera {

// True if it was taken as the photograph of SmallLens.
inline bool RunImageTarget(const std::string& bytes) {
  const MemoryFile file(bytes);
  const StatusOr<ImageSize> size = ReadImageSize(file.path());
  if (size.ok()) {
    Require(size->width > 0 && size->height > 0, "an image has pixels");
  } else {
    RequireRefusal(size.status());
  }
  const StatusOr<FloatImage> luminance = ReadLuminance(file.path(), SmallLens());
  if (!luminance.ok()) RequireRefusal(luminance.status());
  const StatusOr<ByteImage> colours = ReadRgb(file.path());
  if (!colours.ok()) RequireRefusal(colours.status());
  const StatusOr<LabelImage> labels = ReadLabelImage(file.path());
  if (!labels.ok()) RequireRefusal(labels.status());
  if (luminance.ok()) Require(size.ok() && *size == ImageSize{16, 12}, "the header says what is decoded");
  return luminance.ok();
}

}  // namespace tessera
