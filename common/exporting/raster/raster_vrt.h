// Virtual rasters of GDAL, which show the files of all sheets as one.
#pragma once

#include <string>
#include <vector>

#include "common/exporting/raster/geotiff.h"
#include "common/exporting/raster/raster_grid.h"
#include "common/exporting/raster/raster_map.h"
#include "common/exporting/raster/raster_pixels.h"
#include "common/scene/scene.h"

namespace tessera {

struct VrtSource {
  std::string file;  // relative to the VRT
  RasterBox box;
};

// The XML of the mosaic of at least one source. Where boxes overlap, pixels without data hide nothing.
std::string MosaicVrt(RasterContent content, const RasterMap& map, const std::vector<SceneClass>& classes,
                      const std::vector<VrtSource>& sources);

}  // namespace tessera
