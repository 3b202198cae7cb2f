// Coordinate frames of scenes, and the local metric frame that everything inside uses. By GeographicLib.
#ifndef TESSERA_COMMON_GEODESY_FRAME_H_
#define TESSERA_COMMON_GEODESY_FRAME_H_

#include <Eigen/Core>
#include <string>

#include "common/base/status.h"

namespace tessera {

// What scene.json's "crs" says.
struct Crs {
  enum class Kind { kLocal, kEnu, kUtm, kEcef };
  Kind kind = Kind::kLocal;
  double lat_rad = 0, lon_rad = 0, height_m = 0;  // kEnu: WGS 84 origin
  int zone = 0;                                   // kUtm
  bool north = true;                              // kUtm
  bool operator==(const Crs&) const = default;
};

// A rigid change of coordinates between the scene's own frame and the local frame: p_local = rotation (p_scene −
// origin). For local, enu and utm the rotation is the identity and the origin a multiple of 1,024 m in each axis, near
// the scene, so that nothing is rounded. For ecef the local frame is east-north-up at a point near the scene.
class Frame {
 public:
  Frame() = default;  // the identity
  // The frame for a scene around `point_in_scene`.
  static StatusOr<Frame> Around(const Crs& crs, const Eigen::Vector3d& point_in_scene);
  // One that Around() gave earlier.
  static Frame Of(const Crs& crs, const Eigen::Vector3d& origin_in_scene,
                  const Eigen::Matrix3d& rotation_local_from_scene);

  const Crs& crs() const { return crs_; }
  const Eigen::Vector3d& origin_in_scene() const { return origin_; }
  const Eigen::Matrix3d& rotation_local_from_scene() const { return rotation_; }
  Eigen::Vector3d LocalFromScene(const Eigen::Vector3d& p) const { return rotation_ * (p - origin_); }
  Eigen::Vector3d SceneFromLocal(const Eigen::Vector3d& p) const { return rotation_.transpose() * p + origin_; }

  // WGS 84 latitude and longitude (radians) and height (metres) of a local point; FAILED_PRECONDITION for kLocal, which
  // knows no place on Earth.
  StatusOr<Eigen::Vector3d> GeodeticFromLocal(const Eigen::Vector3d& p_local) const;

 private:
  Crs crs_;
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d rotation_ = Eigen::Matrix3d::Identity();
};

}  // namespace tessera

#endif  // TESSERA_COMMON_GEODESY_FRAME_H_
