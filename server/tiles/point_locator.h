// Where points of a job's 3D tiles are.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "common/base/status.h"
#include "common/exporting/export_map.h"
#include "common/exporting/export_scene.h"
#include "common/geodesy/reference_system.h"
#include "common/job/survey.h"

namespace tessera {

struct LocatedPoint {
  std::string crs;                     // of `p`: as exports have it by default; empty: none
  Eigen::Vector3d p;                   // easting or longitude, northing or latitude, height, in units of the system
  Eigen::Vector3d in_scene, in_local;  // metres
  std::optional<Eigen::Vector3d> geodetic;  // WGS 84 latitude and longitude (radians), height (metres)
};

// Converts between the frame of the 3D tiles (that below the root of tileset.json, GlobeMap) and the coordinates of a
// job, with the operations that exports use. Safe to call concurrently; calls wait for each other.
class PointLocator {
 public:
  // INVALID_ARGUMENT if a grid is missing or the survey is damaged.
  static StatusOr<PointLocator> Open(const Survey& survey);

  // INVALID_ARGUMENT if the point has no coordinates in the system.
  StatusOr<LocatedPoint> Locate(const Eigen::Vector3d& p_in_tiles) const;
  // On the ground plane, metres.
  Eigen::Vector2d OnGround(const LocatedPoint& point) const { return scene_.ground.Coordinates(point.in_local); }
  // In the frame of the tiles.
  StatusOr<Eigen::Vector3d> TilesFromLocal(const Eigen::Vector3d& p_local) const;

 private:
  StatusOr<Eigen::Vector3d> SceneFromGeodetic(Eigen::Vector3d geodetic) const;

  ExportScene scene_;
  std::optional<GlobeMap> globe_;
  std::optional<ExportMap> map_;
  std::optional<ReferenceSystem> system_;  // of the scene; none: it has no place on the globe
};

}  // namespace tessera
