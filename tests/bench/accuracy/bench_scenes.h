// The scenes that the accuracy bench runs on: synthetic cities, and scenes changed for a question.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/scene/scene.h"
#include "common/synth/synth.h"

namespace tessera {

// Makes the city in `folder` unless an earlier call with the same options already has.
Status EnsureCity(const SynthOptions& options, const std::string& folder);

// An empty `folder` with links to all that is in scene.folder but for `changed`.
Status LinkScene(const SceneDescription& scene, const std::string& changed, const std::string& folder);

// A scene in `folder` (made anew) that is `scene` but for its start mesh, which is the truth with its labels.
Status StartFromTruth(const SceneDescription& scene, const std::string& folder);

// A scene in `folder` (made anew) that is `scene` without the view `view`. The camera model must be COLMAP's text.
Status LeaveOutView(const SceneDescription& scene, size_t view, const std::string& folder);

}  // namespace tessera
