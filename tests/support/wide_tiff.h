// Images of 16 bits, for tests.
#pragma once

#include <cstdint>
#include <string>

#include "common/imaging/raster.h"
#include "tests/support/tiny_scene.h"

namespace tessera {

// Writes the grey values times `factor` as a TIFF of 16 bits.
inline void WriteTiff16(const std::string& path, const ByteImage& grey, int factor) {
  std::string bytes("II*\0\x08\0\0\0\x09\0", 10);
  const auto add = [&bytes](uint32_t value, int count) {
    for (int i = 0; i < count; ++i) bytes.push_back(static_cast<char>(value >> (8 * i)));
  };
  const auto entry = [&](uint32_t tag, uint32_t value) { add(tag, 2), add(4, 2), add(1, 4), add(value, 4); };
  const uint32_t width = grey.width, height = grey.height, offset = 8 + 2 + 9 * 12 + 4;
  entry(256, width), entry(257, height), entry(258, 16), entry(259, 1), entry(262, 1), entry(273, offset);
  entry(277, 1), entry(278, height), entry(279, 2 * width * height);
  add(0, 4);
  for (size_t i = 0; i < grey.plane_size(); ++i) add(static_cast<uint32_t>(grey.data[i] * factor), 2);
  WriteText(path, bytes);
}

}  // namespace tessera
