// Loading of partly invalid scenes, for callers that report all errors.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/scene/scene.h"

namespace tessera {

// Like LoadScene, but adds all errors to `faults` and returns the readable part. image_path is empty if the image is
// missing or has a wrong size, likelihood_path if likelihoods are missing, mesh_path if there is no mesh file.
SceneDescription LoadSceneCollecting(const std::string& path, const SceneLoadOptions& options, Warnings* warnings,
                                     Faults* faults);

}  // namespace tessera
