#include "worker/changes/change_raster.h"

#include <limits>

namespace tessera {
namespace {

constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

}  // namespace

SurfaceRaster::SurfaceRaster(const CellRect& rect, double cell_size_m) : cells(rect), cell_m(cell_size_m) {
  height_m.assign(size(), kUnknown);
  label.assign(size(), kNoLabel);
}

ChangeRaster::ChangeRaster(const CellRect& rect, double cell_size_m)
    : before(rect, cell_size_m), after(rect, cell_size_m) {
  after_score.assign(before.size(), kUnknown);
  before_score.assign(before.size(), kUnknown);
  label_margin.assign(before.size(), 0.0f);
}

}  // namespace tessera
