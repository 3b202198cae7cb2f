// Options to repair a scene's mesh.
#pragma once

#include <string>
#include <vector>

#include "common/geodesy/frame.h"
#include "common/geometry/repair.h"
#include "common/scene/scene.h"

namespace tessera {

// For a mesh in the local frame `frame`. Withdrawn views are ignored. The scratch folder is the system's.
RepairOptions RepairOptionsOf(const std::vector<SceneView>& views, const Frame& frame);

}  // namespace tessera
