#include "common/exporting/export_map.h"

#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/geodesy/reference_system.h"
#include "common/scene/scene_json.h"

namespace tessera {
namespace {

// A point of the scene in coordinates of `system`, around which its operations are chosen.
StatusOr<Eigen::Vector3d> NearIn(ReferenceSystem* system, const Frame& frame) {
  TESSERA_ASSIGN_OR_RETURN(Eigen::Vector3d near, frame.GeodeticFromLocal(Eigen::Vector3d::Zero()));
  TESSERA_RETURN_IF_ERROR(system->LocateGeodetic(near));
  TESSERA_RETURN_IF_ERROR(system->FromGeodetic({&near, 1}));
  return near;
}

}  // namespace

StatusOr<ExportMap> ExportMap::Open(const ExportScene& scene, const std::string& crs) {
  ExportMap map;
  map.frame_ = scene.frame;
  const bool is_source = scene.source && (crs.empty() || crs == scene.source->crs);
  map.crs_ = is_source ? scene.source->crs : crs;
  const HeightOptions heights = is_source ? scene.source->heights : HeightOptions();
  if (map.crs_.empty() || map.crs_ == "local") return map;
  if (scene.frame.crs().kind == Crs::Kind::kLocal) {
    // The source of a local scene is local too; its name was empty.
    return absl::InvalidArgumentError("crs: found " + map.crs_ +
                                      " for a scene without a coordinate reference system, expected `crs` in "
                                      "scene.json: without it the scene has no place on the globe");
  }
  TESSERA_ASSIGN_OR_RETURN(ReferenceSystem system, ReferenceSystem::Parse(map.crs_, heights));
  TESSERA_ASSIGN_OR_RETURN(const Eigen::Vector3d near, NearIn(&system, scene.frame));
  TESSERA_ASSIGN_OR_RETURN(SceneMap opened,
                           SceneMap::Open({map.crs_, Eigen::Vector3d::Zero()}, scene.frame.crs(), heights, near));
  map.warnings_ = opened.source().warnings();
  map.map_.emplace(std::move(opened));
  return map;
}

Status ExportMap::FromLocal(std::span<Eigen::Vector3d> points) const {
  for (Eigen::Vector3d& p : points) p = frame_.SceneFromLocal(p);
  return map_ ? map_->SourceFromScene(points) : absl::OkStatus();
}

Status ExportMap::ToLocal(std::span<Eigen::Vector3d> points) const {
  if (map_) TESSERA_RETURN_IF_ERROR(map_->SceneFromSource(points));
  for (Eigen::Vector3d& p : points) p = frame_.LocalFromScene(p);
  return absl::OkStatus();
}

StatusOr<Eigen::AlignedBox3d> ExportMap::BoxFromLocal(const Eigen::AlignedBox3d& box, const std::string& what) const {
  std::array<Eigen::Vector3d, 8> corners;
  for (int k = 0; k < 8; ++k) corners[k] = box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(k));
  const Status mapped = FromLocal(corners);
  if (!mapped.ok()) {
    return absl::InvalidArgumentError(
        absl::StrCat(what, ": ", std::string(mapped.message()), ": the system does not cover it: choose another one"));
  }
  Eigen::AlignedBox3d image;
  for (const Eigen::Vector3d& p : corners) image.extend(p);
  return image;
}

StatusOr<GlobeMap> GlobeMap::Open(const ExportScene& scene) {
  GlobeMap map;
  map.frame_ = scene.frame;
  map.on_globe_ = scene.frame.crs().kind != Crs::Kind::kLocal;
  if (!map.on_globe_) {
    map.enu_from_local_.row(0) = scene.ground.axis_x;
    map.enu_from_local_.row(1) = scene.ground.axis_y;
    map.enu_from_local_.row(2) = scene.up;
    return map;
  }
  TESSERA_ASSIGN_OR_RETURN(const Eigen::Vector3d origin, scene.frame.GeodeticFromLocal(Eigen::Vector3d::Zero()));
  const double lat = origin.x(), lon = origin.y();
  Eigen::Matrix3d axes;                                                                   // columns: east, north, up
  axes << -std::sin(lon), -std::sin(lat) * std::cos(lon), std::cos(lat) * std::cos(lon),  //
      std::cos(lon), -std::sin(lat) * std::sin(lon), std::cos(lat) * std::sin(lon),       //
      0, std::cos(lat), std::sin(lat);
  map.ecef_from_enu_.linear() = axes;
  map.ecef_from_enu_.translation() = GeocentricFromGeodetic({lat, lon, 0});
  return map;
}

Status GlobeMap::EnuFromLocal(std::span<Eigen::Vector3d> points) const {
  if (!on_globe_) {
    for (Eigen::Vector3d& p : points) p = enu_from_local_ * p;
    return absl::OkStatus();
  }
  const Eigen::Isometry3d enu_from_ecef = ecef_from_enu_.inverse();
  for (Eigen::Vector3d& p : points) {
    TESSERA_ASSIGN_OR_RETURN(const Eigen::Vector3d geodetic, frame_.GeodeticFromLocal(p));
    p = enu_from_ecef * GeocentricFromGeodetic(geodetic);
  }
  return absl::OkStatus();
}

}  // namespace tessera
