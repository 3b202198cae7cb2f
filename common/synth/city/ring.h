// Footprints as polygons.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

namespace tessera {

// Corners in counter-clockwise order, not closed, metres in the horizontal plane.
using Ring = std::vector<Eigen::Vector2d>;

Eigen::AlignedBox2d BoxOf(const Ring& ring);
Eigen::AlignedBox2d Inflated(const Eigen::AlignedBox2d& box, double by);
Ring RectangleOf(const Eigen::AlignedBox2d& box);
double AreaOf(const Ring& ring);
bool Inside(const Ring& ring, const Eigen::Vector2d& p);

// The points of a square lattice inside the ring.
std::vector<Eigen::Vector2d> PointsInside(const Ring& ring, double spacing_m);

// The ring with its corners moved away from its centre; the sides of a rectangle move by about `by`.
Ring Widened(const Ring& ring, double by);

// The union of two approximately convex rings, star-shaped around a common point; none if they do not overlap.
std::optional<Ring> UnionOf(const Ring& a, const Ring& b);

}  // namespace tessera
