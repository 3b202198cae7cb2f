// Footprints as rings of corners.
#ifndef TESSERA_COMMON_SYNTH_RING_H_
#define TESSERA_COMMON_SYNTH_RING_H_

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

namespace tessera {

// Corners counter-clockwise, not closed, metres in the plan.
using Ring = std::vector<Eigen::Vector2d>;

Eigen::AlignedBox2d BoxOf(const Ring& ring);
Eigen::AlignedBox2d Inflated(const Eigen::AlignedBox2d& box, double by);
Ring RectangleOf(const Eigen::AlignedBox2d& box);
double AreaOf(const Ring& ring);
bool Inside(const Ring& ring, const Eigen::Vector2d& p);

// Points of a square lattice that lie inside the ring.
std::vector<Eigen::Vector2d> PointsInside(const Ring& ring, double spacing_m);

// The ring with each corner further from its middle: a rectangle's sides by about `by`.
Ring Widened(const Ring& ring, double by);

// The outline of two nearly convex rings that overlap, as seen from a point in both; none if they do not overlap.
std::optional<Ring> UnionOf(const Ring& a, const Ring& b);

}  // namespace tessera

#endif  // TESSERA_COMMON_SYNTH_RING_H_
