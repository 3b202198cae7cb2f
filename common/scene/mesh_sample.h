// A sample of a scene's start mesh, for estimates: reads a few faces and not the whole file.
#pragma once

#include <cstdint>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/scene/scene.h"
#include "common/storage/allowed_files.h"

namespace tessera {

inline constexpr int64_t kSampledFaces = 24'000;

struct MeshSample {
  int64_t faces = 0;  // of the whole file, as its header declares
  // At most kSampledFaces of them, spread evenly over the file, in the local frame; each has its own three vertices.
  // Empty if the file must be read from its start to find a face: text, polygons, other formats than PLY.
  TriangleMesh mesh;
};

// Reads the header of the mesh file, and the sample if it is a binary PLY of triangles. Reads less than 16 MiB. `faces`
// is -1 if the header of the format does not declare it. Errors of AllowedFiles::Open; INVALID_ARGUMENT for a PLY whose
// header or sampled faces are wrong.
StatusOr<MeshSample> SampleSceneMesh(const SceneDescription& scene, const AllowedFiles& allowed);

}  // namespace tessera
