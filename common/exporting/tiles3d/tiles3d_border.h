// Borders of the tiles above the sheets, which have fewer vertices at each level.
//
// The border of a tile are the edges that it has in common with another tile. Rims of holes and of the city are no
// border. If all border edges stayed, the border of a tile that is a kilometre wide would have more triangles than its
// inside. So each level removes border vertices, and neighbouring tiles of a level remove the same ones: a chain of
// border edges between two points where other chains or other tiles meet is simplified by its own positions alone
// (Douglas and Peucker 1973), which are the same on both sides. Tiles of one level fit together without gaps, as those
// of a sheet do.
//
// Beside finer tiles there are gaps. The tolerance t(n) of level n is proportional to the side of a tile, so it doubles
// from level to level. The border of level n is made from that of level n - 1, and no point of either is farther than
// t(n) from the other. So the gap between level n and any finer level is at most t(1) + ... + t(n) < 2 t(n). The
// geometric error of a tile of level n is at least kTiles3dGapsInError * 2 t(n). A viewer shows a tile only where that
// error, seen from the nearest point of the tile's box, is below the error that it allows, and no gap is nearer than
// this point. So a gap covers at most 1 / kTiles3dGapsInError of the allowed error: 1 pixel of 8.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "common/exporting/tiles3d/tiles3d_mesh.h"

namespace tessera {

inline constexpr double kTiles3dGapsInError = 8;

// Two ends of an edge.
using Tiles3dEdge = std::array<Eigen::Vector3d, 2>;

// The edges between vertices that other tiles may have. In the order of their vertices.
std::vector<std::array<uint32_t, 2>> Tiles3dSharedEdges(const Tiles3dVertices& vertices, const Tiles3dFaces& faces);

// The faces without the vertices of the border that the tolerance allows to remove; vertices do not move. The border
// are the edges that another tile has too. No two vertices of Tiles3dSharedEdges are at one position. `others`:
// Tiles3dSharedEdges of each other tile of the level that touches this one; more do no harm. Sets vertices->shared: 1
// for the vertices of the border that stay. Where the border ends at the rim of a hole, it may end earlier by `free_m`,
// as the rim itself may. `source`: gets the face before of each face. Deterministic; the removed vertices depend on
// positions of edges alone.
Tiles3dFaces ThinTiles3dBorder(const Tiles3dFaces& faces, const std::vector<std::vector<Tiles3dEdge>>& others,
                               double tolerance_m, double free_m, Tiles3dVertices* vertices,
                               std::vector<uint32_t>* source);

// The vertices of a chain that stay, ascending: its ends, and as many as it takes that no point of the chain is farther
// than the tolerance from the edges that are left. A closed chain begins and ends with one position; it may shrink to
// it. The same vertices stay if the chain is reversed.
std::vector<size_t> SimplifyTiles3dChain(const std::vector<Eigen::Vector3d>& chain, double tolerance_m);

}  // namespace tessera
