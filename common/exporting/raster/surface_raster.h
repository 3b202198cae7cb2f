// The surface of a sheet as seen from above, per pixel of its raster.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/exporting/export_format.h"
#include "common/exporting/raster/raster_grid.h"
#include "common/exporting/raster/raster_map.h"
#include "common/geometry/mesh.h"

namespace tessera {

// The faces of a sheet and its neighbours that may lie above or below the sheet's pixels.
struct RasterSurface {
  std::vector<Eigen::Vector3d> local;   // vertices, local frame
  std::vector<Eigen::Vector3d> mapped;  // the same vertices in the raster's system
  std::vector<Triangle> faces;          // of the sheet, then of its neighbours
  std::vector<int32_t> labels;          // per face
};

// INVALID_ARGUMENT names a vertex that has no place in the system.
StatusOr<RasterSurface> SurfaceOfSheet(const SheetInput& input, const RasterMap& map);

// Per pixel of a box, rows from the north.
struct TopFaces {
  std::vector<int32_t> face;   // index of the face whose point above the pixel's centre is the highest; -1: none
  std::vector<double> height;  // of that point
};

// Scan conversion in double. `vertices`: in the raster's system. A centre on an edge is in both
// faces of the edge, so a surface without gaps gives pixels without gaps. Of equal heights, the first face wins.
TopFaces FindTopFaces(std::span<const Eigen::Vector3d> vertices, std::span<const Triangle> faces, const RasterBox& box,
                      const Eigen::Vector2d& pixel_size);

// The point of `face` above or below the centre of pixel (column, row) of the box, local frame. The face has an area
// in plan.
Eigen::Vector3d PointOfPixel(const RasterSurface& surface, int32_t face, int column, int row, const RasterBox& box,
                             const Eigen::Vector2d& pixel_size);

// All that the raster formats need of one sheet.
struct SheetRaster {
  RasterBox box;
  RasterSurface surface;
  TopFaces top;  // face is -1 for pixels of other sheets
};
StatusOr<SheetRaster> RasterizeSheet(const SheetInput& input, const RasterMap& map, const TaskControl& control);

}  // namespace tessera
