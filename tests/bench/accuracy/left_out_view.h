// How well meshes carry their images over to a photograph that took no part in making them.
#pragma once

#include <cstdint>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/scene/scene.h"

namespace tessera {

struct LeftOutScore {
  std::vector<double> mean_zncc;  // a mesh
  int64_t pixels = 0;             // of all neighbours together: those compared, the same for all meshes
  int neighbours = 0;
};

// Warps the images of the neighbours of view `left_out` (SelectPairs on meshes[0]) through each mesh into it and
// averages the ZNCC of 7 x 7 windows over the pixels whose windows are whole on every mesh and have texture. Meshes in
// the local frame. A pixel counts if the mesh is there and unhidden in the neighbour.
StatusOr<LeftOutScore> ScoreLeftOutView(const SceneDescription& scene, size_t left_out,
                                        const std::vector<const TriangleMesh*>& meshes);

}  // namespace tessera
