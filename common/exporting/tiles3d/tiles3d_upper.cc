#include "common/exporting/tiles3d/tiles3d_upper.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "common/geometry/nearest_surface.h"

namespace tessera {
namespace {

// With more samples, every second one stays: memory and time are bounded.
constexpr size_t kTileSamples = 500000;

std::vector<Eigen::Vector3d> EverySecond(const std::vector<Eigen::Vector3d>& points) {
  std::vector<Eigen::Vector3d> kept;
  for (size_t i = 0; i < points.size(); i += 2) kept.push_back(points[i]);
  return kept;
}

// Pieces with so many faces, which is what a closed surface shrinks to, may be left out.
constexpr size_t kTileCrumbFaces = 8;

// The faces without small closed pieces that are all within the distance of the others. Sheets have some each: noise
// above roofs, leaves of trees.
Tiles3dFaces WithoutTileCrumbs(const Tiles3dVertices& vertices, const Tiles3dFaces& faces, double distance_m) {
  const size_t count = vertices.positions.size();
  std::vector<uint32_t> piece(count);  // per vertex: another one of its piece; itself: it stands for the piece
  std::iota(piece.begin(), piece.end(), 0);
  const auto piece_of = [&piece](uint32_t v) {
    while (piece[v] != v) v = piece[v] = piece[piece[v]];
    return v;
  };
  for (const Triangle& face : faces.corners) {
    for (const int k : {1, 2}) piece[piece_of(face[k])] = piece_of(face[0]);
  }
  std::vector<size_t> sizes(count, 0);
  for (const Triangle& face : faces.corners) ++sizes[piece_of(face[0])];
  const std::vector<uint8_t> border = Tiles3dBorder(faces, count);
  for (uint32_t v = 0; v < count; ++v) {
    if (border[v]) sizes[piece_of(v)] = faces.size() + kTileCrumbFaces;
  }
  Tiles3dFaces others;
  for (size_t f = 0; f < faces.size(); ++f) {
    if (sizes[piece_of(faces.corners[f][0])] > kTileCrumbFaces) others.Add(faces.corners[f], faces.labels[f]);
  }
  if (others.size() == 0 || others.size() == faces.size()) return faces;
  TriangleMesh mesh;
  mesh.vertices = vertices.positions;
  mesh.faces = others.corners;
  const NearestSurface surface(mesh);
  for (const Triangle& face : faces.corners) {
    size_t& size = sizes[piece_of(face[0])];
    if (size > kTileCrumbFaces) continue;
    for (const uint32_t v : face) {
      if (surface.Find(vertices.positions[v]).distance_m > distance_m) size = faces.size() + kTileCrumbFaces;
    }
  }
  Tiles3dFaces kept;
  for (size_t f = 0; f < faces.size(); ++f) {
    if (sizes[piece_of(faces.corners[f][0])] > kTileCrumbFaces) kept.Add(faces.corners[f], faces.labels[f]);
  }
  return kept;
}

}  // namespace

Tiles3dTarget Tiles3dTargetOf(const Tiles3dSizes& sizes, double side_m, bool photographic) {
  return {sizes.error * side_m, photographic ? sizes.node_faces : 0, sizes.node_faces, sizes.leaf_faces};
}

Tiles3dPart MergeTiles3dParts(std::vector<Tiles3dPart> children) {
  std::vector<Tiles3dMesh> meshes;
  Tiles3dPart part;
  for (Tiles3dPart& child : children) {
    part.set = child.set;
    meshes.push_back(std::move(child.mesh));
    part.samples.insert(part.samples.end(), child.samples.begin(), child.samples.end());
    part.samples_error_m = std::max(part.samples_error_m, child.samples_error_m);
    part.error_m = std::max(part.error_m, child.error_m);
    part.box.extend(child.box);
  }
  part.mesh = MergeTiles3d(meshes);
  return part;
}

double SimplifyTiles3dPart(const std::vector<Tiles3dEdge>& borders, double side_m, double children_error_m,
                           bool photographic, const Tiles3dSizes& sizes, Tiles3dPart* part) {
  const double tolerance_m = sizes.border_tolerance * side_m;
  const Tiles3dVertices& vertices = part->mesh.vertices;
  Tiles3dTarget target = Tiles3dTargetOf(sizes, side_m, photographic);
  target.distance_m /= 2;  // the errors of all levels below add up to as much again
  const Tiles3dFaces thinned =
      ThinTiles3dBorder(vertices, part->mesh.faces, borders, tolerance_m, std::max(tolerance_m, target.distance_m));
  const Tiles3dFaces faces =
      SimplifyTiles3d(vertices, WithoutTileCrumbs(vertices, thinned, target.distance_m), target).faces;
  while (part->samples.size() > kTileSamples) part->samples = EverySecond(part->samples);
  part->error_m = part->samples_error_m + Tiles3dDistance(part->samples, vertices, faces);
  part->mesh = CompactTiles3d(vertices, faces);
  // The parent's error is larger, also where nothing was simplified.
  return std::max({part->error_m, children_error_m + kTiles3dGrid_m, kTiles3dGapsInError * 2 * tolerance_m});
}

}  // namespace tessera
