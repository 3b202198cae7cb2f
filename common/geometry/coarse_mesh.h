// Coarse approximation of a mesh that may be larger than memory.
#pragma once

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "common/geometry/mesh.h"

namespace tessera {

struct CoarseMesh {
  TriangleMesh mesh;   // no labels
  double error_m = 0;  // upper bound of the distance between the two surfaces, in both directions
};

// Vertex clustering (Rossignac and Borrel, 1993): replaces the vertices in each cube of a grid by their mean, and keeps
// the faces whose corners lie in three different cubes. The cube size is chosen for about `clusters` vertices, from the
// mesh's area. Needs 4 bytes per vertex in `scratch_folder`, and memory for the result. Deterministic.
// RESOURCE_EXHAUSTED if the scratch folder is full.
StatusOr<CoarseMesh> CoarsenMesh(const MeshSpans& mesh, int64_t clusters, const std::string& scratch_folder);

}  // namespace tessera
