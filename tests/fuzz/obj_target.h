// OBJ meshes.
#pragma once

#include <string>

#include "common/meshio/obj.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// Parses `bytes`; aborts if what comes out breaks a promise of ParseObj. True if it was taken as a mesh.
inline bool RunObjTarget(const std::string& bytes) {
  const auto require = [](bool condition) { Require(condition, "ParseObj's"); };
  const StatusOr<MeshContent> content = ParseObj(bytes, "input");
  if (!content.ok()) {
    RequireRefusal(content.status());
    require(content.status().message().find("input: ") == 0);
    return false;
  }
  const TriangleMesh& mesh = content->mesh;
  require(mesh.labels.empty());
  require(mesh.vertices.size() <= bytes.size() && mesh.faces.size() <= bytes.size());
  for (const Eigen::Vector3d& vertex : mesh.vertices) require(vertex.allFinite());
  for (const Triangle& face : mesh.faces) {
    for (const uint32_t corner : face) require(corner < mesh.vertices.size());
  }
  return true;
}

}  // namespace tessera
