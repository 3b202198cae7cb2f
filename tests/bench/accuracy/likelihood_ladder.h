// Scenes that differ in their likelihoods alone, from the truth's to worthless ones.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/scene/scene.h"

namespace tessera {

// A scene in `folder` (made anew) that is `scene` with other likelihoods. `rung`:
//   truth      the truth's labels, each with the confidence that label images have
//   grown=N    the same, roofs, buildings and vegetation grown by N pixels
//   shrunk=N   the same, these shrunk by N pixels
//   start      the labels of the scene's start mesh as each view sees it
//   permuted   the truth's, each class called by the name of the next
//   uniform    no class is more likely than another
//   shipped    the scene's own
//   a folder   the likelihoods in it, a file an image, as a scene has them
// INVALID_ARGUMENT for another name; NOT_FOUND if the scene has no truth labels or no labels on its mesh; UNIMPLEMENTED
// where `start` would have to be distorted.
Status MakeRung(const SceneDescription& scene, const std::string& rung, const std::string& folder);

}  // namespace tessera
