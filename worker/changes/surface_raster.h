// Rasterises a mesh from above: heights and labels over the ground plane.
#pragma once

#include <span>

#include "common/geometry/mesh.h"
#include "common/geometry/ray_caster.h"
#include "common/job/ground.h"
#include "worker/changes/change_raster.h"

namespace tessera {

// Topmost surface of a mesh. Const functions are thread-safe.
class TopSurface {
 public:
  // `mesh`: local frame; its labels must outlive the object.
  TopSurface(const MeshSpans& mesh, const GroundPlane& ground);

  struct Point {
    float height_m = 0;  // NaN: no surface
    uint8_t label = kNoLabel;
  };
  // Topmost point above the plane's point (x, y), metres.
  Point At(double x_m, double y_m) const;

 private:
  MeshSpans mesh_;
  Eigen::Vector3d axis_x_, axis_y_, up_;
  double top_m_ = 0;
  RayCaster caster_;
};

// Rasterises `cells` of `ground`: the median height of samples_per_cell² vertical rays, and the most frequent label
// among rays within half a cell of that height. A cell is unknown if most rays miss.
SurfaceRaster DrawSurface(const TopSurface& surface, const GroundPlane& ground, const CellRect& cells,
                          int samples_per_cell = 3);

// The same from given samples: `samples_per_cell` per cell and axis, row-major.
SurfaceRaster CellsOfSamples(std::span<const TopSurface::Point> samples, const CellRect& cells, double cell_m,
                             int samples_per_cell);

}  // namespace tessera
