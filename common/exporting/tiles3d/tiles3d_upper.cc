#include "common/exporting/tiles3d/tiles3d_upper.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "common/exporting/tiles3d/tiles3d_pieces.h"

namespace tessera {
namespace {

// With more samples, every second one stays: memory and time are bounded.
constexpr size_t kTileSamples = 500000;

std::vector<Tiles3dPoint> EverySecond(const std::vector<Tiles3dPoint>& points) {
  std::vector<Tiles3dPoint> kept;
  for (size_t i = 0; i < points.size(); i += 2) kept.push_back(points[i]);
  return kept;
}

}  // namespace

Tiles3dTarget Tiles3dTargetOf(const Tiles3dSizes& sizes, double side_m, bool photographic) {
  return {sizes.error * side_m, photographic ? sizes.node_faces : 0, sizes.node_faces, 2 * sizes.node_faces};
}

Tiles3dPart MergeTiles3dParts(std::vector<Tiles3dPart> children) {
  std::vector<Tiles3dMesh> meshes;
  Tiles3dPart part;
  uint32_t first_face = 0;
  for (Tiles3dPart& child : children) {
    part.set = child.set;
    for (Tiles3dPoint& point : child.samples) {
      point.face += first_face;
      part.samples.push_back(point);
    }
    first_face += static_cast<uint32_t>(child.mesh.faces.size());
    meshes.push_back(std::move(child.mesh));
    part.samples_error_m = std::max(part.samples_error_m, child.samples_error_m);
    part.error_m = std::max(part.error_m, child.error_m);
    part.box.extend(child.box);
  }
  std::vector<uint32_t> source;
  part.mesh = MergeTiles3d(meshes, &source);
  if (part.mesh.faces.size() != first_face) {
    MoveTiles3dPoints(part.mesh.vertices, part.mesh.faces, source, std::numeric_limits<double>::infinity(),
                      &part.samples);
  }
  return part;
}

double SimplifyTiles3dPart(const std::vector<std::vector<Tiles3dEdge>>& borders, double side_m, double children_error_m,
                           bool photographic, const Tiles3dSizes& sizes, Tiles3dPart* part) {
  const double tolerance_m = sizes.border_tolerance * side_m;
  Tiles3dVertices& vertices = part->mesh.vertices;
  Tiles3dTarget target = Tiles3dTargetOf(sizes, side_m, photographic);
  // The error is the sum with samples_error_m.
  target.distance_m = std::max(target.distance_m - part->samples_error_m, target.distance_m / 2);
  while (part->samples.size() > kTileSamples) part->samples = EverySecond(part->samples);
  std::vector<uint32_t> source;
  const Tiles3dFaces thinned =
      ThinTiles3dBorder(part->mesh.faces, borders, tolerance_m, target.distance_m / 2, &vertices, &source);
  MoveTiles3dPoints(vertices, thinned, source, target.distance_m / 2, &part->samples);
  Tiles3dLevel level = SimplifyTiles3d(vertices, thinned, target, vertices.shared, part->samples);
  part->samples = std::move(level.points);
  part->error_m = part->samples_error_m + level.distance_m;
  part->mesh = CompactTiles3d(vertices, level.faces);
  // The parent's error is larger, also where nothing was simplified.
  return std::max({part->error_m, children_error_m + kTiles3dGrid_m, kTiles3dGapsInError * 2 * tolerance_m});
}

}  // namespace tessera
