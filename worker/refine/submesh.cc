#include "worker/refine/submesh.h"

#include <algorithm>

namespace tessera {

Submesh ExtractFaces(const MeshSpans& mesh, std::span<const uint32_t> faces) {
  Submesh out;
  std::vector<uint32_t>& vertices = out.vertices;
  for (const uint32_t f : faces) vertices.insert(vertices.end(), mesh.faces[f].begin(), mesh.faces[f].end());
  std::sort(vertices.begin(), vertices.end());
  vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
  for (const uint32_t v : vertices) out.mesh.vertices.push_back(mesh.vertices[v]);
  for (const uint32_t f : faces) {
    Triangle& face = out.mesh.faces.emplace_back();
    for (int k = 0; k < 3; ++k) {
      const auto position = std::lower_bound(vertices.begin(), vertices.end(), mesh.faces[f][k]);
      face[k] = static_cast<uint32_t>(position - vertices.begin());
    }
    if (!mesh.labels.empty()) out.mesh.labels.push_back(mesh.labels[f]);
  }
  return out;
}

}  // namespace tessera
