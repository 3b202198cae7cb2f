// Borders of the tiles above the sheets, which have fewer vertices at each level.
//
// If all border edges stayed, the border of a tile that is a kilometre wide would have more triangles than its inside.
// So each level removes border vertices, and neighbouring tiles of a level remove the same ones: a chain of border
// edges between two points where three or more chains meet is simplified by its own positions alone (Douglas and
// Peucker 1973), which are the same on both sides. Tiles of one level fit together without gaps, as those of a sheet
// do.
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

// The edges on the border: those that have more faces on one side than on the other. In the order of their vertices.
std::vector<std::array<uint32_t, 2>> Tiles3dBorderEdges(const Tiles3dFaces& faces, size_t vertex_count);

// The faces without the vertices of the border that the tolerance allows to remove; vertices do not move. No two
// vertices of the border are at one position. `others`: the border edges of all other tiles of the level that touch
// this one; more do no harm. Chains that no other tile has, which are rims of holes and of the city, have the tolerance
// `free_m`. Deterministic; the removed vertices depend on positions of border edges alone.
Tiles3dFaces ThinTiles3dBorder(const Tiles3dVertices& vertices, const Tiles3dFaces& faces,
                               const std::vector<Tiles3dEdge>& others, double tolerance_m, double free_m);

// The vertices of a chain that stay, ascending: its ends, and as many as it takes that no point of the chain is farther
// than the tolerance from the edges that are left. A closed chain begins and ends with one position; it may shrink to
// it. The same vertices stay if the chain is reversed.
std::vector<size_t> SimplifyTiles3dChain(const std::vector<Eigen::Vector3d>& chain, double tolerance_m);

}  // namespace tessera
