// Files with one class per pixel, as annotation tools and networks write them: PNG of ids, with a palette or in
// colours; NPY arrays of ids.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/likelihood_form.h"
#include "common/imaging/raster.h"

namespace tessera {

// The labels as stored.
struct StoredLabels {
  static constexpr uint32_t kNone = ~0u;      // the pixel has no label: transparent, or a negative id, or 65535
  static constexpr uint32_t kNoId = 1 << 30;  // IdOf a colour that is no grey
  Raster<uint32_t> values;                    // ids, indices of `palette`, or colours 0xRRGGBB
  bool is_color = false;                      // the values are colours
  std::vector<uint32_t> palette;              // colours of the indices, kNone if transparent; empty: no palette
};

// Reads a PNG of any kind.
StatusOr<StoredLabels> ReadLabelPng(const std::string& path);

// Class ids of the pixels, 255 where unknown; of those outside `part` 255. Unknown are 255 and negative ids,
// transparent pixels, black if it is the colour of no class, and 0 if ids count from 1. INVALID_ARGUMENT with the pixel
// for ids or colours of no class. `path` is for messages.
StatusOr<LabelImage> ClassesOf(const StoredLabels& labels, const std::string& path, int classes,
                               const LikelihoodForm& form, const ImagePart& part);

// The colour of one of the values, and the id that it is if colours do not decide: a grey one is its level.
uint32_t ColorOf(const StoredLabels& labels, uint32_t value);
uint32_t IdOf(const StoredLabels& labels, uint32_t value);

// "#rrggbb".
std::string ColorText(uint32_t color);

// 0xRRGGBB.
inline uint32_t ColorValue(const std::array<uint8_t, 3>& rgb) { return rgb[0] << 16 | rgb[1] << 8 | rgb[2]; }

}  // namespace tessera
