// Cuts a mesh at the borders between the tiles of a source.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/exporting/obj/tile_rects.h"
#include "common/geometry/mesh.h"

namespace tessera {

// A mesh in which no face crosses a line of TileRects.
struct CutMesh {
  std::vector<Eigen::Vector3d> vertices;  // those of the mesh, then the points of cuts
  std::vector<Triangle> faces;            // by the face of the mesh that they are, or are a part of
  std::vector<uint32_t> source_faces;     // that face's index
  std::vector<int32_t> tiles;             // per face: its owner
};

// Cuts faces at all lines of `rects`; x and y of vertices are coordinates of `rects`. Points of cuts lie exactly on
// their line (x == c or y == c), and vertices nearer to a line than TileRects::snap() are moved onto it.
//
// Cuts of an edge depend on the positions of its ends alone. So neighbouring faces share the points of their common
// edge, bit for bit, also if they are in different calls, and the cut mesh has no hole and no T-junction that the mesh
// does not have. Parts without area are left out.
CutMesh CutByRects(std::vector<Eigen::Vector3d> vertices, std::span<const Triangle> faces, const TileRects& rects);

}  // namespace tessera
