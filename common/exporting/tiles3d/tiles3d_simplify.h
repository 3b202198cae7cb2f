// Simplification of a tile to a largest distance.
#pragma once

#include <cstddef>

#include "common/exporting/tiles3d/tiles3d_mesh.h"

namespace tessera {

struct Tiles3dTarget {
  double distance_m = 0;  // largest distance of a vertex of the input to the result
  size_t min_faces = 0;   // the simplification ends with so many faces, besides one for each border vertex
  size_t max_faces = 0;   // if more are left, besides one for each border vertex, the distance grows by steps
};

struct Tiles3dLevel {
  Tiles3dFaces faces;
  double distance_m = 0;  // no vertex of the input is farther than this from `faces`
};

// Collapses edges in the order of their quadric errors (Garland and Heckbert 1997). A collapse is made only if every
// vertex that has been removed there stays within the distance of the new faces (one-sided Hausdorff distance; Klein,
// Liebich and Strasser 1996), no face turns over, and the topology stays (link condition). The quadrics alone, which
// are means over areas, would remove masts, chimneys and trees that cover many pixels. Vertices do not move. All edges
// with one face stay, so the result fits to its neighbours without cracks. Borders of classes collapse along
// themselves; if more than `max_faces` are left that way, they are not kept. Deterministic; on the calling thread.
Tiles3dLevel SimplifyTiles3d(const Tiles3dVertices& vertices, const Tiles3dFaces& faces, const Tiles3dTarget& target);

}  // namespace tessera
