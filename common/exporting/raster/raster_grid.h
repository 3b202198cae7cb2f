// Which pixels of a raster belong to which sheet.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "common/base/status.h"
#include "common/exporting/raster/raster_map.h"
#include "common/exporting/sheet.h"

namespace tessera {

// Boxes of rasters begin and end at multiples of this number of pixels: so overviews of factors up to it fit together.
inline constexpr int kRasterAlignment = 16;

// A rectangle of the grid's pixels. Pixel (i, j) is [i, i + 1) x [j, j + 1) in units of RasterMap::pixel_size, from
// zero of the system; j grows to the north. Rows of files begin in the north.
struct RasterBox {
  int64_t x0 = 0, y0 = 0;  // the pixel in the south-west
  int width = 0, height = 0;
  bool operator==(const RasterBox&) const = default;

  size_t pixels() const { return static_cast<size_t>(width) * height; }
  // Of the corner in the north-west.
  Eigen::Vector2d Corner(const Eigen::Vector2d& pixel_size) const {
    return {static_cast<double>(x0) * pixel_size.x(), static_cast<double>(y0 + height) * pixel_size.y()};
  }
};

// The smallest aligned box that has all pixels of a sheet. INVALID_ARGUMENT if the system cuts the sheet, as at the
// antimeridian.
StatusOr<RasterBox> BoxOfSheet(const RasterMap& map, const ExportScene& scene, const SheetId& id);

// Per pixel of `box`, rows from the north: 1 if the pixel belongs to the sheet. A pixel belongs to the sheet in whose
// ground square its centre lies, at the map's reference height: it depends on the pixel alone, so each pixel belongs to
// exactly one sheet.
StatusOr<std::vector<uint8_t>> PixelsOfSheet(const RasterMap& map, const ExportScene& scene, const SheetId& id,
                                             const RasterBox& box);

}  // namespace tessera
