// Coordinate systems of scenes, and the local metric frame of all computations. Uses GeographicLib, and
// PROJ for projected systems.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>

#include "common/base/status.h"

namespace tessera {

class ReferenceSystem;

// Coordinate reference system of a scene ("crs" in scene.json).
struct Crs {
  enum class Kind { kLocal, kEnu, kUtm, kEcef, kProjected };  // surveys store the number
  Kind kind = Kind::kLocal;
  // kEnu: WGS 84 origin. kProjected: height_m is added to heights to get heights above the WGS 84 ellipsoid, if it is
  // not 0; `vertical_epsg` then only names the datum.
  double lat_rad = 0, lon_rad = 0, height_m = 0;
  int zone = 0;       // kUtm
  bool north = true;  // kUtm
  // kProjected: codes of the map projection and the vertical datum (0: heights are above the WGS 84 ellipsoid).
  // Coordinates are easting, northing and height in metres, also where the system has other units.
  int epsg = 0, vertical_epsg = 0;
  bool operator==(const Crs&) const = default;
};

// Rigid transform between the scene's coordinates and the local frame: p_local = rotation (p_scene − origin). For
// local, enu, utm and projected, the rotation is the identity and each coordinate of the origin is a multiple of 1,024
// m near the scene, so that the subtraction does not round. For ecef, the local frame is east-north-up at a point near
// the scene.
class Frame {
 public:
  Frame() = default;  // the identity
  // The frame of a scene around `point_in_scene`. INVALID_ARGUMENT if `crs` is invalid or does not fit the point.
  static StatusOr<Frame> Around(const Crs& crs, const Eigen::Vector3d& point_in_scene);
  // Restores a frame that Around() returned.
  static Frame Of(const Crs& crs, const Eigen::Vector3d& origin_in_scene,
                  const Eigen::Matrix3d& rotation_local_from_scene);

  const Crs& crs() const { return crs_; }
  const Eigen::Vector3d& origin_in_scene() const { return origin_; }
  const Eigen::Matrix3d& rotation_local_from_scene() const { return rotation_; }
  Eigen::Vector3d LocalFromScene(const Eigen::Vector3d& p) const { return rotation_ * (p - origin_); }
  Eigen::Vector3d SceneFromLocal(const Eigen::Vector3d& p) const { return rotation_.transpose() * p + origin_; }

  // WGS 84 latitude and longitude (radians) and height (metres) of a local point. FAILED_PRECONDITION for kLocal, which
  // is not georeferenced.
  StatusOr<Eigen::Vector3d> GeodeticFromLocal(const Eigen::Vector3d& p_local) const;

 private:
  // Opens system_ around the origin, for kProjected.
  Status OpenSystem();

  Crs crs_;
  std::shared_ptr<const ReferenceSystem> system_;  // kProjected; null if it could not be opened
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d rotation_ = Eigen::Matrix3d::Identity();
};

}  // namespace tessera
