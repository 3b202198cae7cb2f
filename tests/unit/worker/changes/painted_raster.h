// Synthetic change rasters for tests.
#pragma once

#include <vector>

#include "worker/changes/change_areas.h"
#include "worker/changes/change_raster.h"

namespace tessera {

inline const std::vector<ClassRole> kPaintedRoles = {ClassRole::kGround, ClassRole::kBuilding, ClassRole::kBuilding,
                                                     ClassRole::kVegetation};

// Flat, unchanged ground of class 0 at height 10 with high agreement.
inline ChangeRaster FlatRaster(const CellRect& cells, double cell_m) {
  ChangeRaster raster(cells, cell_m);
  raster.before.height_m.assign(raster.before.size(), 10.0f);
  raster.after.height_m = raster.before.height_m;
  raster.before.label.assign(raster.before.size(), 0);
  raster.after.label = raster.before.label;
  raster.before_score.assign(raster.before.size(), 0.9f);
  raster.after_score = raster.before_score;
  return raster;
}

// Sets the old and the new surface in the cells of `part`.
inline void Paint(ChangeRaster* raster, const CellRect& part, float before_m, uint8_t before_label, float after_m,
                  uint8_t after_label) {
  for (int y = part.y0; y < part.y1; ++y) {
    for (int x = part.x0; x < part.x1; ++x) {
      const size_t i = static_cast<size_t>(y - raster->cells().y0) * raster->before.width() + (x - raster->cells().x0);
      raster->before.height_m[i] = before_m;
      raster->before.label[i] = before_label;
      raster->after.height_m[i] = after_m;
      raster->after.label[i] = after_label;
      if (before_m != after_m) raster->before_score[i] = 0.1f;
      if (before_label != after_label) raster->label_margin[i] = 0.6f;
    }
  }
}

}  // namespace tessera
