// Simplification of a tile to a largest distance.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/exporting/tiles3d/tiles3d_mesh.h"

namespace tessera {

// Numbers of faces are besides one for each fixed vertex.
struct Tiles3dTarget {
  double distance_m = 0;   // largest distance of a vertex of the input, or of a point, to the result
  size_t min_faces = 0;    // the simplification ends with so many
  size_t class_faces = 0;  // while more are left, neither borders of classes nor the topology are kept
  size_t max_faces = 0;    // if more are left all the same, the distance grows by steps
};

struct Tiles3dLevel {
  Tiles3dFaces faces;
  std::vector<Tiles3dPoint> points;  // those of the input, and the vertices that have been removed
  double distance_m = 0;             // no point is farther than this from its face
};

// Collapses edges in the order of their quadric errors (Garland and Heckbert 1997). A collapse is made only if every
// point near to its faces stays within the distance of the new faces (one-sided Hausdorff distance; Klein, Liebich and
// Strasser 1996), no face turns over, and the topology stays (link condition). The quadrics alone, which are means over
// areas, would remove masts, chimneys and trees that cover many pixels. Vertices do not move. Borders of classes, rims
// and edges of more than two faces collapse along themselves.
//
// While more than class_faces are left, it gives up the topology and the borders of classes; then the side of faces;
// then it leaves out small pieces, the smallest first (tiles3d_pieces.h), also far from other faces: below half of the
// distance, or 8 times it while more than max_faces are left; distance_m does not count them. At last it grows.
//
// `fixed`: per vertex, 1 if it stays, because another tile has it. Edges between fixed vertices keep a face, so the
// result fits to its neighbours without cracks. `points`: of levels before, near to the faces of the input.
// Deterministic; on the calling thread.
Tiles3dLevel SimplifyTiles3d(const Tiles3dVertices& vertices, const Tiles3dFaces& faces, const Tiles3dTarget& target,
                             const std::vector<uint8_t>& fixed, const std::vector<Tiles3dPoint>& points = {});

}  // namespace tessera
