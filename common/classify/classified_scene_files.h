// What `tessera classify` leaves: a folder that is a scene itself, with the likelihoods beside links to the rest.
#ifndef TESSERA_COMMON_CLASSIFY_CLASSIFIED_SCENE_FILES_H_
#define TESSERA_COMMON_CLASSIFY_CLASSIFIED_SCENE_FILES_H_

#include <string>

#include "common/base/status.h"
#include "common/scene/scene.h"

namespace tessera {

// Refuses a folder that holds anything but an earlier classification: ALREADY_EXISTS. Call it before any work.
Status CheckClassifiedFolder(const std::string& folder);

// FOLDER/scene.json, as `scene_file` but with the likelihoods of FOLDER/geometry, and links `cameras`, `images` and
// `mesh.ply` to the scene's. `source`: what the likelihoods come from, in scene.json's words ("annotations", "model",
// "default").
Status WriteClassifiedScene(const SceneDescription& scene, const std::string& scene_file, const std::string& folder,
                            const std::string& source);

}  // namespace tessera

#endif  // TESSERA_COMMON_CLASSIFY_CLASSIFIED_SCENE_FILES_H_
