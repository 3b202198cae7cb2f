// Outlines of sets of cells.
#ifndef TESSERA_WORKER_CHANGES_OUTLINE_H_
#define TESSERA_WORKER_CHANGES_OUTLINE_H_

#include <Eigen/Core>
#include <vector>

namespace tessera {

// A ring's corners, the first not repeated. Outer rings run counter-clockwise, holes clockwise.
using Ring = std::vector<Eigen::Vector2d>;

struct Outline {
  Ring outer;
  std::vector<Ring> holes;
};

// Positive for counter-clockwise rings.
double SignedArea(const Ring& ring);

// The border of a set of cells that are connected by their sides: cell (x, y) is the unit square from (x, y). Corners
// lie where the border turns.
Outline TraceOutline(const std::vector<Eigen::Vector2i>& cells);

// Douglas and Peucker 1973 on a ring: no corner that is left out lies farther than `tolerance` from the new border. A
// ring that would lose its area stays as it is.
Ring SimplifyRing(const Ring& ring, double tolerance);

}  // namespace tessera

#endif  // TESSERA_WORKER_CHANGES_OUTLINE_H_
