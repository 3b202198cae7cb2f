// Simplification of a tile to a largest distance.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/exporting/tiles3d/tiles3d_mesh.h"

namespace tessera {

// Numbers of faces are besides one for each border vertex.
struct Tiles3dTarget {
  double distance_m = 0;   // largest distance of a vertex of the input, or of a point, to the result
  size_t min_faces = 0;    // the simplification ends with so many
  size_t class_faces = 0;  // while more are left, neither borders of classes nor the topology are kept
  size_t max_faces = 0;    // if more are left all the same, the distance grows by steps
};

// A vertex of the finest mesh that a coarser one lacks.
struct Tiles3dPoint {
  Eigen::Vector3d position;
  uint32_t face = 0;  // index of a face that it is near to
};

struct Tiles3dLevel {
  Tiles3dFaces faces;
  std::vector<Tiles3dPoint> points;  // those of the input, and the vertices that have been removed
  double distance_m = 0;             // no point is farther than this from its face
};

// Collapses edges in the order of their quadric errors (Garland and Heckbert 1997). A collapse is made only if every
// point near to its faces stays within the distance of the new faces (one-sided Hausdorff distance; Klein, Liebich and
// Strasser 1996), no face turns over, and the topology stays (link condition). The quadrics alone, which are means over
// areas, would remove masts, chimneys and trees that cover many pixels. Vertices do not move. All edges with one face
// stay, so the result fits to its neighbours without cracks. Borders of classes collapse along themselves, as long as
// they are kept. `points`: of levels before, near to the faces of the input. Deterministic; on the calling thread.
Tiles3dLevel SimplifyTiles3d(const Tiles3dVertices& vertices, const Tiles3dFaces& faces, const Tiles3dTarget& target,
                             const std::vector<Tiles3dPoint>& points = {});

}  // namespace tessera
