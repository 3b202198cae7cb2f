// The shape of a mesh in few faces, made in passes over a mesh that may be larger than memory.
#ifndef TESSERA_COMMON_GEOMETRY_COARSE_MESH_H_
#define TESSERA_COMMON_GEOMETRY_COARSE_MESH_H_

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "common/geometry/mesh.h"

namespace tessera {

struct CoarseMesh {
  TriangleMesh mesh;   // no labels
  double error_m = 0;  // bound: no point of either surface is farther from the other
};

// Vertex clustering (Rossignac and Borrel, 1993): vertices in the same cube of a grid become their mean; faces with
// corners in three cubes stay. The grid is as fine as gives about `clusters` vertices for the mesh's area.
// `scratch_folder` takes 4 bytes a vertex meanwhile. Memory is that of the result. Deterministic. RESOURCE_EXHAUSTED if
// scratch has no room.
StatusOr<CoarseMesh> CoarsenMesh(const MeshSpans& mesh, int64_t clusters, const std::string& scratch_folder);

}  // namespace tessera

#endif  // TESSERA_COMMON_GEOMETRY_COARSE_MESH_H_
