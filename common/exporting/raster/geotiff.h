// GeoTIFF files of the raster formats. Uses libtiff and libgeotiff.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/exporting/raster/raster_map.h"
#include "common/exporting/raster/raster_pixels.h"
#include "common/scene/scene.h"

namespace tessera {

struct GeoTiffPlace {
  const RasterSystem& system;
  Eigen::Vector2d corner;      // of the first pixel, in the north-west
  Eigen::Vector2d pixel_size;  // units of the system
};

// What a file says of its pixels, besides its place.
struct GeoTiffText {
  std::vector<SceneClass> classes;  // of kClasses: names and colours
  bool quarantined = false;         // some faces are of tiles whose refinement failed
};

// The bytes of a GeoTIFF: tiles of 256 x 256 pixels, deflate with predictor, overviews of factors 2 to 16 for files of
// more than 256 pixels, GDAL's tags for nodata and metadata. A pixel is an area. A system without EPSG code is written
// as its WKT ("ESRI PE String"). The same input gives the same bytes.
StatusOr<std::string> EncodeGeoTiff(const RasterPixels& pixels, const GeoTiffPlace& place, const GeoTiffText& text);

// "m", "ft", "US survey foot", or the size in metres.
std::string RasterUnitName(double unit_m);

}  // namespace tessera
