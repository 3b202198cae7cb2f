#include "worker/changes/change_raster.h"

#include <algorithm>

namespace tessera {

CellRect CommonCells(const CellRect& a, const CellRect& b) {
  return {std::max(a.x0, b.x0), std::max(a.y0, b.y0), std::min(a.x1, b.x1), std::min(a.y1, b.y1)};
}
SurfaceRaster::SurfaceRaster(const CellRect& rect, double cell_size_m) : cells(rect), cell_m(cell_size_m) {
  height_m.assign(size(), kNotKnown);
  label.assign(size(), kNoLabel);
}

ChangeRaster::ChangeRaster(const CellRect& rect, double cell_size_m)
    : before(rect, cell_size_m), after(rect, cell_size_m) {
  after_score.assign(before.size(), kNotKnown);
  before_score.assign(before.size(), kNotKnown);
  label_margin.assign(before.size(), 0.0f);
}

}  // namespace tessera
