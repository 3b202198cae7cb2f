// The ground plane with its grid of cells, in which tiles are planned.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace tessera {

// Orthonormal axes of the plane perpendicular to `up`, local frame; x and y of the frame if up is z. Cells are squares
// of side `cell_m`; their corners are multiples of cell_m from the frame's origin and do not depend on the tiling.
struct GroundPlane {
  Eigen::Vector3d axis_x = Eigen::Vector3d::UnitX();
  Eigen::Vector3d axis_y = Eigen::Vector3d::UnitY();
  double cell_m = 1;

  Eigen::Vector2d Coordinates(const Eigen::Vector3d& p) const { return {axis_x.dot(p), axis_y.dot(p)}; }
  Eigen::Vector2i Cell(const Eigen::Vector3d& p) const {
    const Eigen::Vector2d c = Coordinates(p) / cell_m;
    return {static_cast<int>(std::floor(c.x())), static_cast<int>(std::floor(c.y()))};
  }
};

// Side of the cells of a scene: about 64 GSD, a power of two in metres.
inline double CellSide_m(double gsd_m) {
  constexpr double kCellGsd = 64;
  return std::exp2(std::round(std::log2(kCellGsd * gsd_m)));
}

// The ground plane perpendicular to the unit vector `up`.
inline GroundPlane MakeGroundPlane(const Eigen::Vector3d& up, double cell_m) {
  GroundPlane ground;
  ground.cell_m = cell_m;
  if (up != Eigen::Vector3d::UnitZ()) {
    // Project the coordinate axis that is most perpendicular to `up` to get the first direction.
    int least = 0;
    for (int k = 1; k < 3; ++k) {
      if (std::abs(up[k]) < std::abs(up[least])) least = k;
    }
    const Eigen::Vector3d axis = Eigen::Vector3d::Unit(least);
    ground.axis_x = (axis - up * up.dot(axis)).normalized();
    ground.axis_y = up.cross(ground.axis_x);
  }
  return ground;
}

// Half-open rectangle of cells.
struct CellRect {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  bool empty() const { return x0 >= x1 || y0 >= y1; }
  bool Contains(const Eigen::Vector2i& cell) const {
    return cell.x() >= x0 && cell.x() < x1 && cell.y() >= y0 && cell.y() < y1;
  }
  bool operator==(const CellRect&) const = default;
};

// Distance in metres from a point of the plane to the rectangle; 0 inside.
inline double DistanceToRect(const Eigen::Vector2d& p, const CellRect& rect, double cell_m) {
  const double dx = std::max({rect.x0 * cell_m - p.x(), p.x() - rect.x1 * cell_m, 0.0});
  const double dy = std::max({rect.y0 * cell_m - p.y(), p.y() - rect.y1 * cell_m, 0.0});
  return std::hypot(dx, dy);
}

// Distance in metres between two rectangles; 0 if they touch.
inline double DistanceBetween(const CellRect& a, const CellRect& b, double cell_m) {
  const double dx = std::max({a.x0 - b.x1, b.x0 - a.x1, 0}) * cell_m;
  const double dy = std::max({a.y0 - b.y1, b.y0 - a.y1, 0}) * cell_m;
  return std::hypot(dx, dy);
}

}  // namespace tessera
