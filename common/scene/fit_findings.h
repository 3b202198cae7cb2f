// What the fit of a scene (MeasureFit) says to its user.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/scene/fit.h"
#include "common/scene/fit_readings.h"

namespace tessera {

// Whether FindReading should look for what is wrong with the whole scene.
bool NeedsReading(const SceneFit& fit, double gsd_m);

// INVALID_ARGUMENT if images, poses and mesh correlate no better than by chance, with the reading that would fit. Adds
// warnings about misplaced views, poses, focal lengths, a shifted mesh and a bad fit.
Status JudgeFit(const SceneDescription& scene, const SceneFit& fit, const Reading& reading, double gsd_m,
                Warnings* warnings);

// "88 % of 13225 patches above chance; median offset ...", or "not measured: ..."
std::string FitText(const SceneFit& fit);

}  // namespace tessera
