// The map of a job: where its tiles and cameras are. For the pages and files that draw it. Plain values, without
// pixels or meshes.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "common/job/survey.h"

namespace tessera {

// A rectangle of the ground plane (GroundPlane::Coordinates), metres.
struct GroundRect {
  double x0_m = 0, y0_m = 0, x1_m = 0, y1_m = 0;
  friend bool operator==(const GroundRect&, const GroundRect&) = default;
};

GroundRect RectOnGround(const CellRect& cells, const GroundPlane& ground);

struct MapTile {
  std::vector<GroundRect> core;  // disjoint; none: the tile was removed by an update
  std::vector<int32_t> views;    // that its cells chose, ascending indices in GroundMap::views
};

struct MapView {
  std::string image;                          // path relative to the scene's folder
  Eigen::Vector3d centre, direction;          // frame of the scene, metres; the optical axis as a unit vector
  Eigen::Vector2d on_ground, ground_heading;  // the same two, projected to the ground plane
};

struct GroundMap {
  std::vector<MapTile> tiles;  // by number
  std::vector<MapView> views;  // in the order of the survey
};

// `cores`: cells of each tile, by number; empty of a removed tile. Thread-safe.
GroundMap MakeGroundMap(const Survey& survey, const std::vector<CellRect>& cores);

}  // namespace tessera
