// glTF meshes.
#pragma once

#include <string>

#include "common/meshio/gltf.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// Parses `bytes`, with and without labels; aborts if what comes out breaks a promise of ParseGltf. True if it was taken
// as a mesh.
inline bool RunGltfTarget(const std::string& bytes) {
  const auto require = [](bool condition) { Require(condition, "ParseGltf's"); };
  const StatusOr<MeshContent> content = ParseGltf(bytes, "input");
  if (!content.ok()) {
    RequireRefusal(content.status());
    require(content.status().message().find("input: ") == 0);
  }
  MaterialNames materials;
  MeshReadOptions options;
  options.materials = &materials;
  const StatusOr<MeshContent> labelled = ParseGltf(bytes, "input", options);
  if (!content.ok() || !labelled.ok()) return false;
  const TriangleMesh& mesh = content->mesh;
  require(mesh.labels.empty() && labelled->mesh.labels.size() == mesh.faces.size());
  require(labelled->mesh.faces == mesh.faces);
  for (const Eigen::Vector3d& vertex : mesh.vertices) require(vertex.allFinite());
  for (const Triangle& face : mesh.faces) {
    for (const uint32_t corner : face) require(corner < mesh.vertices.size());
    require(face[0] != face[1] && face[1] != face[2] && face[2] != face[0]);
  }
  for (const int32_t label : labelled->mesh.labels) {
    require(label >= -1 && label < static_cast<int32_t>(materials.names().size()));
  }
  return true;
}

}  // namespace tessera
