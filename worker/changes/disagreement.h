// How much the epochs disagree: the new images against the surface that the earlier ones left.
#ifndef TESSERA_WORKER_CHANGES_DISAGREEMENT_H_
#define TESSERA_WORKER_CHANGES_DISAGREEMENT_H_

#include <optional>
#include <span>

#include "worker/changes/change_areas.h"
#include "worker/changes/change_raster.h"

namespace tessera {

// Over the cells that the new images know and of which there is an old surface. No old pixel is read: earlier images
// speak through the surface and the labels that were made of them, so light and season count for nothing. All 0 if
// there is no such cell.
struct EpochDisagreement {
  // Photo term: mean ZNCC of the new images on what they show and on the old surface. Equal where nothing changed.
  double agreement = 0, agreement_before = 0;
  struct Shares {
    double heights = 0;  // of the cells: heights, and so silhouettes, differ as those of changed areas
    double labels = 0;   // of the cells with both labels: classes differ, roof and facade counted as one
  };
  Shares before;                  // of the new images with the old surface
  std::optional<Shares> refined;  // of the new images with the result: what it does not follow

  // So much that it is worth a warning.
  bool IsLarge() const;
};

// `refined`: what the refined mesh shows, or empty.
EpochDisagreement MeasureDisagreement(const ChangeRaster& raster, std::span<const SurfaceRaster> refined,
                                      const std::vector<ClassRole>& roles, double gsd_m,
                                      const ChangeAreaOptions& options);

}  // namespace tessera

#endif  // TESSERA_WORKER_CHANGES_DISAGREEMENT_H_
