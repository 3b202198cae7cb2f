// Borders of a mesh that lie at the same place but have vertices of their own: triangle soups, tiles, texture charts.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "common/geometry/mesh.h"

namespace tessera {

// Two open edges at the same place, of two faces.
struct CoincidentEdges {
  std::array<uint32_t, 2> faces;
  std::array<uint32_t, 2> from, to;  // the vertices of either edge: from[0] and from[1] are at the same place
  bool same_direction = false;       // `from` is the start of both directed edges, or only of the first
};

// Open edges (start corners 3 f + k, as in MeshAnalysis::open_edges) whose ends are at the same places, where exactly
// two edges meet. Positions are at the same place if they lie in one cell, or in cells that touch, of a grid of half
// the tolerance; or if they are connected by such positions. The tolerance is four times the rounding of the largest
// coordinate as a 32-bit float, at most a thousandth of the median edge, and a power of two.
// The result does not depend on the order of `open_edges`. Positions are finite. Memory: a few numbers per open edge.
std::vector<CoincidentEdges> FindCoincidentEdges(const MeshSpans& mesh, std::span<const uint64_t> open_edges);

// The vertices to merge so that each pair of edges becomes one edge: (vertex, lowest vertex of its place), by ascending
// vertex.
std::vector<std::pair<uint32_t, uint32_t>> VerticesToMerge(std::span<const CoincidentEdges> edges);

}  // namespace tessera
