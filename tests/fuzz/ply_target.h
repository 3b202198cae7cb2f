// PLY meshes.
#pragma once

#include <string>

#include "common/meshio/ply.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// Parses `bytes`; aborts if what comes out breaks a promise of ParsePly. True if it was taken as a mesh.
inline bool RunPlyTarget(const std::string& bytes) {
  const auto require = [](bool condition) { Require(condition, "ParsePly's"); };
  const StatusOr<MeshContent> content = ParsePly(bytes, "input");
  if (!content.ok()) {
    require(content.status().code() == absl::StatusCode::kInvalidArgument);
    require(content.status().message().find("input: ") == 0);
    require(content.status().message().size() < 500);
    return false;
  }
  const TriangleMesh& mesh = content->mesh;
  require(mesh.labels.empty() || mesh.labels.size() == mesh.faces.size());
  require(mesh.vertices.capacity() <= 2 * bytes.size() && mesh.faces.capacity() <= 2 * bytes.size());
  for (const Eigen::Vector3d& vertex : mesh.vertices) require(vertex.allFinite());
  for (const Triangle& face : mesh.faces) {
    for (const uint32_t corner : face) require(corner < mesh.vertices.size());
  }
  for (const int32_t label : mesh.labels) require(label >= -1);
  return true;
}

}  // namespace tessera
