// Outlines of sets of cells as polygons.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace tessera {

// Corners of a ring, the first not repeated. Outer rings are counter-clockwise, holes clockwise.
using Ring = std::vector<Eigen::Vector2d>;

struct Outline {
  Ring outer;
  std::vector<Ring> holes;
};

// Positive for counter-clockwise rings.
double SignedArea(const Ring& ring);

// Boundary polygon of a set of 4-connected cells. Cell (x, y) is the unit square whose lowest corner is (x, y).
// Corners are only where the direction changes.
Outline TraceOutline(const std::vector<Eigen::Vector2i>& cells);

// Simplifies a closed ring (Douglas and Peucker 1973): removed corners lie within `tolerance` of the new ring. A ring
// that would degenerate is returned unchanged.
Ring SimplifyRing(const Ring& ring, double tolerance);

}  // namespace tessera
