#include "common/exporting/tiles3d/tiles3d_upper.h"

#include <algorithm>
#include <utility>

namespace tessera {
namespace {

// With more samples, the vertices of the level below take their place: memory and time stay bounded, and the error adds
// up less often than at every level.
constexpr size_t kTileSamples = 500000;

}  // namespace

Tiles3dTarget Tiles3dTargetOf(const Tiles3dSizes& sizes, double side_m, bool photographic) {
  // The distances of all levels below add up to as much again.
  return {sizes.error * side_m / 2, photographic ? sizes.picture_faces : 0, sizes.node_faces};
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
  const Tiles3dTarget target = Tiles3dTargetOf(sizes, side_m, photographic);
  const Tiles3dFaces thinned =
      ThinTiles3dBorder(vertices, part->mesh.faces, borders, tolerance_m, std::max(tolerance_m, target.distance_m));
  const Tiles3dFaces faces = SimplifyTiles3d(vertices, thinned, target).faces;
  if (part->samples.size() > kTileSamples) {
    part->samples = vertices.positions;
    part->samples_error_m = part->error_m;
  }
  part->error_m = part->samples_error_m + Tiles3dDistance(part->samples, vertices, faces);
  part->mesh = CompactTiles3d(vertices, faces);
  // The parent's error is larger, also where nothing was simplified.
  return std::max({part->error_m, children_error_m + kTiles3dGrid_m, kTiles3dGapsInError * 2 * tolerance_m});
}

}  // namespace tessera
