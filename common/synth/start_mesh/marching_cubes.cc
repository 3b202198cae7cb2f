#include "common/synth/start_mesh/marching_cubes.h"

#include <algorithm>

namespace tessera {
namespace {

// Corners of each face, counter-clockwise seen from outside the cube.
constexpr int kFaceCorners[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};

int EdgeBetween(int a, int b) {
  const int difference = a ^ b, low = std::min(a, b);
  const int axis = difference == 1 ? 0 : difference == 2 ? 1 : 2;
  const auto& edges = CubeEdgeTable();
  for (int e = 0; e < kCubeEdges; ++e) {
    if (edges[e].axis == axis && edges[e].corner == low) return e;
  }
  return -1;
}

// Bit f is set if the edge lies in face f.
int FacesOfEdge(int edge) {
  const CubeEdge& e = CubeEdgeTable()[edge];
  const int other = e.corner | (1 << e.axis);
  int faces = 0;
  for (int f = 0; f < 6; ++f) {
    const auto has = [&](int corner) { return std::count(kFaceCorners[f], kFaceCorners[f] + 4, corner) > 0; };
    if (has(e.corner) && has(other)) faces |= 1 << f;
  }
  return faces;
}

// Rotates the loop so that no diagonal of the fan from its first edge lies in a face of the cube. A diagonal in a face
// could coincide with an edge of the neighbouring cube's surface, which would make a non-manifold edge.
CubeLoop ChooseFan(std::vector<int> edges) {
  for (size_t turn = 0; turn < edges.size(); ++turn) {
    bool clear = true;
    for (size_t k = 2; k + 1 < edges.size(); ++k) clear = clear && (FacesOfEdge(edges[0]) & FacesOfEdge(edges[k])) == 0;
    if (clear) return {edges, false};
    std::rotate(edges.begin(), edges.begin() + 1, edges.end());
  }
  return {edges, true};
}

// On each face, the surface connects the edge where a run of inside corners starts with the edge where it ends.
// Following these connections around the cube gives closed loops for every case, without a table written by hand.
std::vector<CubeLoop> TraceLoops(int inside) {
  std::array<int, kCubeEdges> next;
  next.fill(-1);
  for (const auto& corners : kFaceCorners) {
    const auto in = [&](int k) { return (inside >> corners[k & 3] & 1) != 0; };
    for (int k = 0; k < 4; ++k) {
      if (in(k) || !in(k + 1)) continue;  // the edge before the first inside corner
      int last = k + 1;
      while (in(last + 1)) ++last;  // the last inside corner
      next[EdgeBetween(corners[k], corners[(k + 1) & 3])] = EdgeBetween(corners[last & 3], corners[(last + 1) & 3]);
    }
  }
  std::vector<CubeLoop> loops;
  for (int start = 0; start < kCubeEdges; ++start) {
    std::vector<int> edges;
    for (int e = start; next[e] >= 0;) {
      edges.push_back(e);
      const int following = next[e];
      next[e] = -1;
      e = following;
    }
    if (!edges.empty()) loops.push_back(ChooseFan(std::move(edges)));
  }
  return loops;
}

}  // namespace

const std::array<CubeEdge, kCubeEdges>& CubeEdgeTable() {
  static const std::array<CubeEdge, kCubeEdges> table = {
      {{0, 0}, {0, 2}, {0, 4}, {0, 6}, {1, 0}, {1, 1}, {1, 4}, {1, 5}, {2, 0}, {2, 1}, {2, 2}, {2, 3}}};
  return table;
}

const std::array<std::vector<CubeLoop>, 256>& CubeLoopTable() {
  static const std::array<std::vector<CubeLoop>, 256> table = [] {
    std::array<std::vector<CubeLoop>, 256> loops;
    for (int inside = 0; inside < 256; ++inside) loops[inside] = TraceLoops(inside);
    return loops;
  }();
  return table;
}

}  // namespace tessera
