#include "server/tiles/point_locator.h"

#include <utility>

#include "common/base/printable.h"

namespace tessera {
namespace {

constexpr size_t kMaxNameBytes = 60;

// A definition (WKT) is no name.
std::string NameOf(const std::string& crs) {
  if (crs.size() <= kMaxNameBytes) return crs;
  const auto system = ReferenceSystem::Parse(crs);
  return system.ok() ? system->name() : std::string(Prefix(crs, kMaxNameBytes));
}

}  // namespace

StatusOr<PointLocator> PointLocator::Open(const Survey& survey) {
  PointLocator locator;
  TESSERA_ASSIGN_OR_RETURN(locator.scene_, ExportSceneOf(survey));
  TESSERA_ASSIGN_OR_RETURN(locator.globe_, GlobeMap::Open(locator.scene_));
  TESSERA_ASSIGN_OR_RETURN(locator.map_, ExportMap::Open(locator.scene_, ""));
  if (!locator.globe_->on_globe()) return locator;
  const Frame& frame = locator.scene_.frame;
  TESSERA_ASSIGN_OR_RETURN(ReferenceSystem system, ReferenceSystem::Of(frame.crs()));
  TESSERA_RETURN_IF_ERROR(system.Locate(frame.origin_in_scene().cwiseQuotient(system.units_m())));  // as Frame
  locator.system_ = std::move(system);
  return locator;
}

StatusOr<Eigen::Vector3d> PointLocator::SceneFromGeodetic(Eigen::Vector3d geodetic) const {
  TESSERA_RETURN_IF_ERROR(system_->FromGeodetic({&geodetic, 1}));
  return Eigen::Vector3d(geodetic.cwiseProduct(system_->units_m()));
}

StatusOr<LocatedPoint> PointLocator::Locate(const Eigen::Vector3d& p_in_tiles) const {
  if (!p_in_tiles.allFinite()) return absl::InvalidArgumentError("point: found numbers that are not finite");
  LocatedPoint point;
  const Frame& frame = scene_.frame;
  if (system_) {
    point.geodetic = GeodeticFromGeocentric(globe_->ecef_from_enu() * p_in_tiles);
    TESSERA_ASSIGN_OR_RETURN(point.in_scene, SceneFromGeodetic(*point.geodetic));
    point.in_local = frame.LocalFromScene(point.in_scene);
  } else {
    point.in_local =
        scene_.ground.axis_x * p_in_tiles.x() + scene_.ground.axis_y * p_in_tiles.y() + scene_.up * p_in_tiles.z();
    point.in_scene = frame.SceneFromLocal(point.in_local);
  }
  point.p = point.in_local;
  TESSERA_RETURN_IF_ERROR(map_->FromLocal({&point.p, 1}));
  point.crs = !map_->crs().empty() && map_->crs() != "local" ? NameOf(map_->crs()) : system_ ? system_->name() : "";
  return point;
}

StatusOr<Eigen::Vector3d> PointLocator::TilesFromLocal(const Eigen::Vector3d& p_local) const {
  Eigen::Vector3d p = p_local;
  TESSERA_RETURN_IF_ERROR(globe_->EnuFromLocal({&p, 1}));
  return p;
}

}  // namespace tessera
