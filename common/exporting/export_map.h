// From the job's local frame to the coordinates of exported files.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <span>
#include <string>

#include "common/base/status.h"
#include "common/exporting/export_scene.h"
#include "common/importing/frames.h"

namespace tessera {

// The map from the local frame to a coordinate reference system. Safe to call concurrently; calls wait for each other.
class ExportMap {
 public:
  // `crs` as ReferenceSystem::Parse reads it. Empty, or that of the scene's source: the source's with its heights, else
  // the scene's own coordinates. INVALID_ARGUMENT if the scene has no coordinate reference system and `crs` is given,
  // if a grid is missing, and as ReferenceSystem.
  static StatusOr<ExportMap> Open(const ExportScene& scene, const std::string& crs);

  // In place: points of the local frame to coordinates of the system (easting or longitude, northing or latitude,
  // height, in its units), without an offset, and back. INVALID_ARGUMENT names a point without image.
  Status FromLocal(std::span<Eigen::Vector3d> points) const;
  Status ToLocal(std::span<Eigen::Vector3d> points) const;
  // The box around the images of the corners of `box`. INVALID_ARGUMENT that names `what`, the content of the box, if
  // the system does not cover it.
  StatusOr<Eigen::AlignedBox3d> BoxFromLocal(const Eigen::AlignedBox3d& box, const std::string& what) const;

  // The system as text (EPSG:32633+5773, ENU:LAT,LON,H); empty: the scene's local coordinates.
  const std::string& crs() const { return crs_; }
  const Warnings& warnings() const { return warnings_; }

 private:
  Frame frame_;
  std::optional<SceneMap> map_;  // none: the scene's coordinates
  std::string crs_;
  Warnings warnings_;
};

// The map from the local frame to one east-north-up frame on the WGS 84 ellipsoid, for outputs on the globe. If the
// scene has no coordinate reference system, it has no place: then it is the rotation that takes up to z.
class GlobeMap {
 public:
  static StatusOr<GlobeMap> Open(const ExportScene& scene);

  bool on_globe() const { return on_globe_; }
  // In place. Equal points have equal images, bit for bit.
  Status EnuFromLocal(std::span<Eigen::Vector3d> points) const;
  // Earth-centred metres from the frame's coordinates; the identity if !on_globe().
  const Eigen::Isometry3d& ecef_from_enu() const { return ecef_from_enu_; }

 private:
  Frame frame_;
  bool on_globe_ = false;
  Eigen::Isometry3d ecef_from_enu_ = Eigen::Isometry3d::Identity();
  Eigen::Matrix3d enu_from_local_ = Eigen::Matrix3d::Identity();  // if !on_globe_
};

}  // namespace tessera
