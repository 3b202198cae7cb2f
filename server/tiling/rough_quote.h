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

// The survey that ingest would make, estimated for the cells of the whole area of `sample`, or for a share of it if the
// city is large. Precondition: the sample has faces. FAILED_PRECONDITION if no image shows one.
StatusOr<Survey> SurveyOfSample(const SceneDescription& scene, const MeshSample& sample, bool classifies,
                                double* share);

// Quotes of SurveyOfSample, each figure with the range that kRoughLow and kRoughHigh give. Errors as SurveyOfSample and
// MakeQuote. Thread-safe.
StatusOr<RoughQuote> MakeRoughQuote(const JobSettings& settings, const SceneDescription& scene,
                                    const MeshSample& sample);

// By how much figures of surveys differ from those of samples (tests/unit/server/tiling, and the scenes campus,
// helsinki and block): the area, the faces after splitting, and all that depends on them.
inline constexpr double kRoughLow = 0.6, kRoughHigh = 1.6;

}  // namespace tessera
