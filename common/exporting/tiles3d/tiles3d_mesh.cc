#include "common/exporting/tiles3d/tiles3d_mesh.h"

#include <algorithm>
#include <utility>

#include "common/base/random.h"

namespace tessera {
namespace {

constexpr uint32_t kNoTiles3dIndex = std::numeric_limits<uint32_t>::max();

template <class T>
std::vector<T> TakeTiles3d(const std::vector<T>& values, const std::vector<uint32_t>& which) {
  std::vector<T> taken;
  if (values.empty()) return taken;
  taken.reserve(which.size());
  for (const uint32_t i : which) taken.push_back(values[i]);
  return taken;
}

}  // namespace

void Tiles3dFaces::Append(const Tiles3dFaces& other) {
  corners.insert(corners.end(), other.corners.begin(), other.corners.end());
  labels.insert(labels.end(), other.labels.begin(), other.labels.end());
}

Tiles3dMesh CompactTiles3d(const Tiles3dVertices& vertices, const Tiles3dFaces& faces) {
  Tiles3dMesh mesh;
  mesh.faces.labels = faces.labels;
  mesh.faces.corners.reserve(faces.size());
  std::vector<uint32_t> number(vertices.positions.size(), kNoTiles3dIndex);
  for (const Triangle& face : faces.corners) {
    Triangle& out = mesh.faces.corners.emplace_back();
    for (int k = 0; k < 3; ++k) {
      uint32_t& n = number[face[k]];
      if (n == kNoTiles3dIndex) {
        n = static_cast<uint32_t>(mesh.vertex_of.size());
        mesh.vertex_of.push_back(face[k]);
      }
      out[k] = n;
    }
  }
  mesh.vertices.positions = TakeTiles3d(vertices.positions, mesh.vertex_of);
  mesh.vertices.normals = TakeTiles3d(vertices.normals, mesh.vertex_of);
  mesh.vertices.confidence = TakeTiles3d(vertices.confidence, mesh.vertex_of);
  mesh.vertices.displacement_m = TakeTiles3d(vertices.displacement_m, mesh.vertex_of);
  mesh.vertices.colors = TakeTiles3d(vertices.colors, mesh.vertex_of);
  mesh.vertices.shared = TakeTiles3d(vertices.shared, mesh.vertex_of);
  return mesh;
}

Tiles3dWedges MakeTiles3dWedges(const Tiles3dFaces& faces, size_t vertex_count) {
  Tiles3dWedges wedges;
  wedges.faces.reserve(faces.size());
  std::vector<uint32_t> first(vertex_count, kNoTiles3dIndex), next;  // lists of the wedges of each vertex
  for (size_t f = 0; f < faces.size(); ++f) {
    Triangle& out = wedges.faces.emplace_back();
    for (int k = 0; k < 3; ++k) {
      const uint32_t v = faces.corners[f][k];
      uint32_t wedge = first[v];
      while (wedge != kNoTiles3dIndex && wedges.labels[wedge] != faces.labels[f]) wedge = next[wedge];
      if (wedge == kNoTiles3dIndex) {
        wedge = static_cast<uint32_t>(wedges.vertices.size());
        wedges.vertices.push_back(v);
        wedges.labels.push_back(faces.labels[f]);
        next.push_back(first[v]);
        first[v] = wedge;
      }
      out[k] = wedge;
    }
  }
  return wedges;
}

std::vector<uint8_t> Tiles3dBorder(const Tiles3dFaces& faces, size_t vertex_count) {
  // Around a vertex inside, each neighbour comes once as the next and once as the previous corner of a face: sums of
  // hashes cancel.
  std::vector<uint64_t> sums(vertex_count, 0);
  for (const Triangle& face : faces.corners) {
    for (int k = 0; k < 3; ++k) sums[face[k]] += MixBits(face[(k + 1) % 3]) - MixBits(face[(k + 2) % 3]);
  }
  std::vector<uint8_t> border(vertex_count);
  std::transform(sums.begin(), sums.end(), border.begin(), [](uint64_t sum) { return sum != 0 ? 1 : 0; });
  return border;
}

}  // namespace tessera
