// Disagreement between epochs: the new images against the surface that earlier images produced.
#pragma once

#include <optional>
#include <span>

#include "worker/changes/change_areas.h"
#include "worker/changes/change_raster.h"

namespace tessera {

// Statistics over the cells that the new images show and that have an old surface; all 0 if there is none. Old images
// are not read, only the surface and labels made from them, so differences of light and season do not count.
struct EpochDisagreement {
  // Photo term: mean ZNCC of the new images on the new and on the old surface; equal where nothing changed.
  double agreement = 0, agreement_before = 0;
  struct Shares {
    double heights = 0;  // share of cells whose height differs as in a change
    double labels = 0;   // share of cells with both labels whose classes differ; roof and facade count as one
  };
  Shares before;                  // new images against the old surface
  std::optional<Shares> refined;  // new images against the refined mesh

  // True if large enough for a warning.
  bool IsLarge() const;
};

// `refined`: rasters of the refined mesh, or empty.
EpochDisagreement MeasureDisagreement(const ChangeRaster& raster, std::span<const SurfaceRaster> refined,
                                      const std::vector<ClassRole>& roles, double gsd_m,
                                      const ChangeAreaOptions& options);

}  // namespace tessera
