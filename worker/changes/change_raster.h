// What a new flight shows of the ground plane's cells, against the surface that was there before.
#ifndef TESSERA_WORKER_CHANGES_CHANGE_RASTER_H_
#define TESSERA_WORKER_CHANGES_CHANGE_RASTER_H_

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "common/job/ground.h"

namespace tessera {

inline constexpr uint8_t kNoLabel = 255;
inline constexpr float kNotKnown = std::numeric_limits<float>::quiet_NaN();  // of heights and scores

// The cells that both have; none where x0 >= x1 or y0 >= y1.
CellRect CommonCells(const CellRect& a, const CellRect& b);

// Cells are those of a GroundPlane with this cell_m, row after row from the lowest y. Heights are coordinates along the
// plane's up, metres, of the local frame; NaN: not known.
struct SurfaceRaster {
  CellRect cells;
  double cell_m = 1;
  std::vector<float> height_m;  // of the topmost surface
  std::vector<uint8_t> label;   // of its face; kNoLabel: none

  SurfaceRaster() = default;
  SurfaceRaster(const CellRect& rect, double cell_size_m);
  int width() const { return cells.x1 - cells.x0; }
  int height() const { return cells.y1 - cells.y0; }
  size_t size() const { return static_cast<size_t>(width()) * height(); }
};

// A cell is known where at least two new views see it; where not, `after.height_m` is NaN.
struct ChangeRaster {
  SurfaceRaster before;  // the old surface
  SurfaceRaster after;   // what the new images show; label: the likeliest class
  // Agreement of the new images (mean ZNCC of the pairs that agree best, -1 to 1) on the surface after and on the one
  // before; NaN where not known.
  std::vector<float> after_score, before_score;
  // Mean likelihood of the label after less that of the label before; 0 where they are the same or one is missing.
  std::vector<float> label_margin;

  ChangeRaster() = default;
  ChangeRaster(const CellRect& rect, double cell_size_m);
  const CellRect& cells() const { return before.cells; }
  double cell_m() const { return before.cell_m; }
};

}  // namespace tessera

#endif  // TESSERA_WORKER_CHANGES_CHANGE_RASTER_H_
