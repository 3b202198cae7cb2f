// Marching cubes (Lorensen, Cline 1987) whose table is made by tracing, so that the surface is always a manifold.
#ifndef TESSERA_COMMON_SYNTH_MARCHING_CUBES_H_
#define TESSERA_COMMON_SYNTH_MARCHING_CUBES_H_

#include <array>
#include <vector>

namespace tessera {

// Cube corners are numbered by the bits x = 1, y = 2, z = 4. An edge is named by its axis and its lower corner.
struct CubeEdge {
  int axis;
  int corner;
};
inline constexpr int kCubeEdges = 12;
const std::array<CubeEdge, kCubeEdges>& CubeEdgeTable();

// The closed loops of edges along which the surface crosses the cube, counter-clockwise seen from outside (where the
// corner bit is 0), for each of 256 sets of inside corners. On faces with two opposite inside corners these are kept
// apart, by either cube alike.
// `needs_centre`: no fan over the loop keeps its diagonals off the cube's faces; then the fan goes around a vertex in
// the middle. Else the fan starts at the loop's first edge.
struct CubeLoop {
  std::vector<int> edges;
  bool needs_centre = false;
};
const std::array<std::vector<CubeLoop>, 256>& CubeLoopTable();

}  // namespace tessera

#endif  // TESSERA_COMMON_SYNTH_MARCHING_CUBES_H_
