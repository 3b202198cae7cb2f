// Rasters of the old and new surface over the ground plane's cells.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/ground.h"

namespace tessera {

inline constexpr uint8_t kNoLabel = 255;
inline constexpr float kNotKnown = std::numeric_limits<float>::quiet_NaN();  // of heights and scores

// Cells of a GroundPlane with this cell_m, row by row from the lowest y. Heights are metres along the plane's up,
// local frame; NaN: unknown.
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

// A cell is known if at least two new views see it; `after.height_m` is NaN in all others.
struct ChangeRaster {
  SurfaceRaster before;  // old surface
  SurfaceRaster after;   // surface in the new images; label: of greatest likelihood
  // Agreement of the new images on the new and on the old surface: mean ZNCC of the best pairs, -1 to 1; NaN:
  // unknown.
  std::vector<float> after_score, before_score;
  // Mean likelihood of the new label less that of the old one; 0 if they are equal or one is missing.
  std::vector<float> label_margin;

  ChangeRaster() = default;
  ChangeRaster(const CellRect& rect, double cell_size_m);
  const CellRect& cells() const { return before.cells; }
  double cell_m() const { return before.cell_m; }
};

// Copies the cells of `part` that both rasters have.
void CopyCells(const SurfaceRaster& from, const CellRect& part, SurfaceRaster* to);
void CopyCells(const ChangeRaster& from, const CellRect& part, ChangeRaster* to);

// As files passed between tasks. DATA_LOSS if the file is damaged.
Status WriteChangeRaster(const std::string& path, const ChangeRaster& raster);
StatusOr<ChangeRaster> ReadChangeRaster(const std::string& path);

}  // namespace tessera
