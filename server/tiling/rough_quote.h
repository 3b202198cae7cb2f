// A rough cost of a job from the poses of its images and a sample of its start mesh, before anything is surveyed.
#pragma once

#include "common/base/status.h"
#include "common/scene/mesh_sample.h"
#include "server/tiling/quote.h"

namespace tessera {

struct RoughQuote {
  Interval tiles, core_seconds, peak_bytes, stored_bytes, area_m2;
  double gsd_m = 0;
  double share = 1;  // of the area, that the figures were computed on; of a large city a part
};

inline constexpr size_t kRoughCells = 10'000;

// The survey that ingest would make, estimated for the ground cells of `sample`, or for a share of them if they are
// more than `most_cells`. Precondition: the sample has faces. FAILED_PRECONDITION if no image shows one.
StatusOr<Survey> SurveyOfSample(const SceneDescription& scene, const MeshSample& sample, bool classifies,
                                size_t most_cells, double* share);

// Quotes of SurveyOfSample, each figure with the range that kRoughLow and kRoughHigh give. Errors as SurveyOfSample and
// MakeQuote. Thread-safe.
StatusOr<RoughQuote> MakeRoughQuote(const JobSettings& settings, const SceneDescription& scene,
                                    const MeshSample& sample, size_t most_cells = kRoughCells);

// By how much figures of surveys may differ from those of samples. On the scenes campus, helsinki and block the sample
// gives 0 to 18 % less than EstimateSurvey of the whole mesh, which does not test occlusion.
inline constexpr double kRoughLow = 0.6, kRoughHigh = 1.6;

}  // namespace tessera
