// The output folder of `tessera classify`: a scene that contains the likelihoods and links to the other files.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/scene/scene.h"

namespace tessera {

// ALREADY_EXISTS if the folder holds anything but an earlier output of `tessera classify`. Call it before classifying.
Status CheckClassifiedFolder(const std::string& folder);

// Writes FOLDER/scene.json, a copy of `scene_file` with the likelihoods in FOLDER/geometry, and the links `cameras`,
// `images` and `mesh.ply` to the scene's files. `source`: the value of "likelihoods_source" ("annotations", "model",
// "default").
Status WriteClassifiedScene(const SceneDescription& scene, const std::string& scene_file, const std::string& folder,
                            const std::string& source);

}  // namespace tessera
