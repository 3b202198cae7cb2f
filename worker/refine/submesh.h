// Parts of meshes as meshes of their own.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/geometry/mesh.h"

namespace tessera {

// `mesh` has labels if the whole mesh has them.
struct Submesh {
  TriangleMesh mesh;
  std::vector<uint32_t> vertices;  // index in the whole mesh of each vertex, ascending
};

// The listed faces, in the order of the list, with the vertices that they use.
Submesh ExtractFaces(const MeshSpans& mesh, std::span<const uint32_t> faces);

}  // namespace tessera
