#include "common/exporting/tiles3d/tiles3d_mesh.h"

#include <meshoptimizer.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <utility>

#include "common/base/random.h"
#include "common/geometry/nearest_surface.h"

namespace tessera {
namespace {

constexpr uint32_t kNoTiles3dIndex = std::numeric_limits<uint32_t>::max();
// With so many times the wanted faces, borders of classes are given up.
constexpr double kTiles3dTooMany = 1.5;

template <class T>
std::vector<T> TakeTiles3d(const std::vector<T>& values, const std::vector<uint32_t>& which) {
  std::vector<T> taken;
  if (values.empty()) return taken;
  taken.reserve(which.size());
  for (const uint32_t i : which) taken.push_back(values[i]);
  return taken;
}

TriangleMesh TileSurfaceOf(const Tiles3dVertices& vertices, const Tiles3dFaces& faces) {
  TriangleMesh mesh;
  mesh.vertices = vertices.positions;
  mesh.faces = faces.corners;
  return mesh;
}

// meshoptimizer's result over wedges. Wedges at equal positions are a seam, which it keeps.
Tiles3dFaces SimplifyTiles3dWedges(const Tiles3dVertices& vertices, const Tiles3dWedges& wedges, size_t target) {
  Eigen::AlignedBox3d box;
  for (const uint32_t v : wedges.vertices) box.extend(vertices.positions[v]);
  std::vector<Eigen::Vector3f> positions;
  positions.reserve(wedges.vertices.size());
  for (const uint32_t v : wedges.vertices) {
    positions.push_back((vertices.positions[v] - box.center()).cast<float>());
  }
  const size_t count = 3 * wedges.faces.size();
  std::vector<Triangle> kept(wedges.faces.size());
  const size_t left = meshopt_simplify(kept.data()->data(), wedges.faces.data()->data(), count,
                                       positions.data()->data(), positions.size(), sizeof(Eigen::Vector3f), 3 * target,
                                       std::numeric_limits<float>::max(), meshopt_SimplifyLockBorder, nullptr);
  Tiles3dFaces result;
  for (size_t f = 0; f < left / 3; ++f) {
    const Triangle& face = kept[f];
    result.Add({wedges.vertices[face[0]], wedges.vertices[face[1]], wedges.vertices[face[2]]}, wedges.labels[face[0]]);
  }
  return result;
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

Tiles3dFaces SimplifyTiles3d(const Tiles3dVertices& vertices, const Tiles3dFaces& faces, size_t inner_faces) {
  const std::vector<uint8_t> border = Tiles3dBorder(faces, vertices.positions.size());
  const size_t target = inner_faces + static_cast<size_t>(std::count(border.begin(), border.end(), 1));
  if (faces.size() <= target) return faces;
  Tiles3dFaces simple = SimplifyTiles3dWedges(vertices, MakeTiles3dWedges(faces, vertices.positions.size()), target);
  if (static_cast<double>(simple.size()) <= kTiles3dTooMany * static_cast<double>(target)) return simple;
  const TriangleMesh before = TileSurfaceOf(vertices, simple);
  const std::vector<int32_t> labels = std::move(simple.labels);
  simple.labels.assign(labels.size(), 0);
  simple = SimplifyTiles3dWedges(vertices, MakeTiles3dWedges(simple, vertices.positions.size()), target);
  const NearestSurface surface(before);
  for (size_t f = 0; f < simple.size(); ++f) {
    const Triangle& face = simple.corners[f];
    const Eigen::Vector3d centroid =
        (vertices.positions[face[0]] + vertices.positions[face[1]] + vertices.positions[face[2]]) / 3;
    simple.labels[f] = labels[surface.Find(centroid).face];
  }
  return simple;
}

double Tiles3dDistance(const std::vector<Eigen::Vector3d>& points, const Tiles3dVertices& vertices,
                       const Tiles3dFaces& faces) {
  const TriangleMesh mesh = TileSurfaceOf(vertices, faces);
  const NearestSurface surface(mesh);
  double distance_m = 0;
  for (const Eigen::Vector3d& p : points) distance_m = std::max(distance_m, surface.Find(p).distance_m);
  return distance_m;
}

}  // namespace tessera
