#include "worker/changes/disagreement.h"

#include <cmath>

namespace tessera {
namespace {

constexpr double kLargeShare = 0.2, kLargeLoss = 0.25;

double Share(size_t part, size_t of) { return of > 0 ? static_cast<double>(part) / static_cast<double>(of) : 0; }

EpochDisagreement::Shares Compare(const SurfaceRaster& surface, const ChangeRaster& raster,
                                  const std::vector<ClassRole>& roles, double threshold_m) {
  size_t cells = 0, moved = 0, labelled = 0, relabelled = 0;
  for (size_t i = 0; i < surface.size(); ++i) {
    const double difference_m = raster.after.height_m[i] - surface.height_m[i];
    if (std::isnan(difference_m)) continue;
    ++cells;
    moved += std::abs(difference_m) > threshold_m;
    const uint8_t label = surface.label[i], seen = raster.after.label[i];
    if (label == kNoLabel || seen == kNoLabel) continue;
    ++labelled;
    relabelled += ClassesDiffer(roles, label, seen);
  }
  return {Share(moved, cells), Share(relabelled, labelled)};
}

}  // namespace

bool EpochDisagreement::IsLarge() const {
  return before.heights > kLargeShare || before.labels > kLargeShare || agreement - agreement_before > kLargeLoss;
}

EpochDisagreement MeasureDisagreement(const ChangeRaster& raster, std::span<const SurfaceRaster> refined,
                                      const std::vector<ClassRole>& roles, double gsd_m,
                                      const ChangeAreaOptions& options) {
  EpochDisagreement result;
  double after = 0, before = 0;
  size_t cells = 0;
  for (size_t i = 0; i < raster.before.size(); ++i) {
    if (std::isnan(raster.after_score[i]) || std::isnan(raster.before_score[i])) continue;
    ++cells;
    after += raster.after_score[i];
    before += raster.before_score[i];
  }
  if (cells > 0) {
    result.agreement = after / static_cast<double>(cells);
    result.agreement_before = before / static_cast<double>(cells);
  }
  const double threshold_m = HeightThreshold_m(options, gsd_m);
  result.before = Compare(raster.before, raster, roles, threshold_m);
  if (!refined.empty()) {
    result.refined = Compare(MergeSurfaces(refined, raster.cells(), raster.cell_m()), raster, roles, threshold_m);
  }
  return result;
}

}  // namespace tessera
