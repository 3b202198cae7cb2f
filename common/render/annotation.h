// Captions, legends and pictures side by side.
#ifndef TESSERA_COMMON_RENDER_ANNOTATION_H_
#define TESSERA_COMMON_RENDER_ANNOTATION_H_

#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "common/imaging/raster.h"

namespace tessera {

// All pictures are RGB; text is ASCII.

// `left` | `right` with a white strip between them. Both of one height.
ByteImage SideBySide(const ByteImage& left, const ByteImage& right);

// Writes `text` into the top left corner, dark with a light border so that it reads on anything.
void DrawCaption(ByteImage* image, const std::string& text);

// Names with their colours, down the left side from the bottom.
void DrawLegend(ByteImage* image, const std::vector<std::pair<std::string, std::array<uint8_t, 3>>>& entries);

// The bar of DivergingColor from -range_m to range_m along the bottom, with its numbers.
void DrawDisplacementBar(ByteImage* image, double range_m);

}  // namespace tessera

#endif  // TESSERA_COMMON_RENDER_ANNOTATION_H_
