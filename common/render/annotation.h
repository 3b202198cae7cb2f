// Captions, legends and side-by-side images. All images are RGB; text is ASCII.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "common/imaging/raster.h"

namespace tessera {

// `left` and `right` side by side with a white strip between them. Both have the same height.
ByteImage SideBySide(const ByteImage& left, const ByteImage& right);

// Draws `text` in the top left corner, dark with a light outline, so that it is legible on any background.
void DrawCaption(ByteImage* image, const std::string& text);

// Draws names and their colours at the bottom left, one line each.
void DrawLegend(ByteImage* image, const std::vector<std::pair<std::string, std::array<uint8_t, 3>>>& entries);

// Draws the colour scale of DivergingColor from -range_m to range_m at the bottom, with tick labels.
void DrawDisplacementBar(ByteImage* image, double range_m);

}  // namespace tessera
