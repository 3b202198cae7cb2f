// Loading a scene as far as it goes, for those who report everything that is wrong with it.
#ifndef TESSERA_COMMON_SCENE_LOADING_H_
#define TESSERA_COMMON_SCENE_LOADING_H_

#include <string>

#include "common/base/status.h"
#include "common/scene/scene.h"

namespace tessera {

// LoadScene's work: every fault goes into `faults`, and what could be read comes back. A view whose image is missing or
// of the wrong size has an empty image_path, one without its likelihoods an empty likelihood_path; mesh_path is empty
// if there is no such file.
SceneDescription LoadSceneCollecting(const std::string& path, const SceneLoadOptions& options, Warnings* warnings,
                                     Faults* faults);

}  // namespace tessera

#endif  // TESSERA_COMMON_SCENE_LOADING_H_
