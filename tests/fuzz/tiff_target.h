// Multi-page TIFF files, whole and in part.
#pragma once

#include <cstring>
#include <string>

#include "common/imaging/tiff_file.h"
#include "tests/fuzz/memory_file.h"

namespace tessera {

// True if it was taken as pages. Those of many pixels are left, as whoever reads them compares their size first.
inline bool RunTiffTarget(const std::string& bytes) {
  const MemoryFile file(bytes);
  const StatusOr<TiffSize> size = ReadTiffSize(file.path());
  if (!size.ok()) {
    RequireRefusal(size.status());
    return false;
  }
  Require(size->width > 0 && size->height > 0 && size->pages > 0, "a TIFF has pixels");
  if (int64_t{size->width} * size->height * size->pages > 1 << 20) return false;
  const StatusOr<FloatImage> whole = ReadTiffPages(file.path(), *size);
  if (!whole.ok()) {
    RequireRefusal(whole.status());
    return false;
  }
  const ImagePart part = {size->width / 3, size->height / 2, size->width, size->height};
  const StatusOr<FloatImage> some = ReadTiffPages(file.path(), *size, part);
  Require(some.ok(), "a part of what can be read can be read");
  for (int c = 0; c < some->channels; ++c) {
    for (int y = 0; y < some->height; ++y) {
      for (int x = 0; x < some->width; ++x) {
        Require(std::memcmp(&some->at(x, y, c), &whole->at(x + part.x0, y + part.y0, c), sizeof(float)) == 0,
                "a part is as in the whole");
      }
    }
  }
  return true;
}

}  // namespace tessera
