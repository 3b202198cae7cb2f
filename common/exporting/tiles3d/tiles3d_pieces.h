// Small pieces of a tile's mesh: leaves of trees, noise above roofs. They cannot be simplified, only left out.
#pragma once

#include <cstdint>
#include <vector>

#include "common/exporting/tiles3d/tiles3d_mesh.h"

namespace tessera {

// Which pieces are left out. Faces with a common edge are of one piece.
struct Tiles3dPieceLimits {
  double distance_m = 0;  // small pieces whose vertices and points are all within this distance of the other faces
  double size_m = 0;      // pieces whose box has a shorter diagonal, wherever they are
  size_t enough = 0;      // no more pieces are left out if so many faces are left; the smallest go first
};

// The faces without small pieces and without repeated faces. Pieces with a fixed vertex stay, and if all pieces are
// small, the largest one. `points`: near to their faces; they move to the faces that are left, with the vertices of
// pieces within `distance_m`. Those of pieces below `size_m` go with them. Deterministic; on the calling thread.
Tiles3dFaces WithoutSmallTiles3dPieces(const Tiles3dVertices& vertices, const Tiles3dFaces& faces,
                                       const std::vector<uint8_t>& fixed, const Tiles3dPieceLimits& limits,
                                       std::vector<Tiles3dPoint>* points);

// Moves points to other faces: `source`: per face, the face before that it was made of. Points without one, or farther
// than `near_m` from it, go to the nearest face. The faces are at least one.
void MoveTiles3dPoints(const Tiles3dVertices& vertices, const Tiles3dFaces& faces, const std::vector<uint32_t>& source,
                       double near_m, std::vector<Tiles3dPoint>* points);

}  // namespace tessera
