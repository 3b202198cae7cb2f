#include "common/geodesy/frame.h"

#include <GeographicLib/Geocentric.hpp>
#include <GeographicLib/LocalCartesian.hpp>
#include <GeographicLib/UTMUPS.hpp>
#include <cmath>
#include <numbers>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/geodesy/reference_system.h"

namespace tessera {
namespace {

constexpr double kDegreesPerRadian = 180 / std::numbers::pi;
constexpr double kOriginGrid_m = 1024;

// Multiples of 1,024 have few significant bits, so subtracting one from a nearby coordinate is exact.
Eigen::Vector3d RoundToGrid(const Eigen::Vector3d& p) {
  return (p / kOriginGrid_m).unaryExpr([](double x) { return std::round(x) + 0.0; }) * kOriginGrid_m;
}

Eigen::Vector3d Geodetic(double lat_deg, double lon_deg, double height_m) {
  return {lat_deg / kDegreesPerRadian, lon_deg / kDegreesPerRadian, height_m};
}

Status CheckCrs(const Crs& crs) {
  if (crs.kind == Crs::Kind::kUtm && (crs.zone < 1 || crs.zone > 60)) {
    return absl::InvalidArgumentError(absl::StrCat("crs: found UTM zone ", crs.zone, ", expected 1 to 60"));
  }
  if (crs.kind == Crs::Kind::kEnu && !(std::abs(crs.lat_rad) <= std::numbers::pi / 2 &&
                                       std::abs(crs.lon_rad) <= 2 * std::numbers::pi && std::isfinite(crs.height_m))) {
    return absl::InvalidArgumentError(
        absl::StrCat("crs: found an origin at latitude ", crs.lat_rad * kDegreesPerRadian, ", longitude ",
                     crs.lon_rad * kDegreesPerRadian, ", height ", crs.height_m,
                     ", expected -90 to 90 degrees, -360 to 360 degrees, a finite height"));
  }
  if (crs.kind == Crs::Kind::kProjected && !std::isfinite(crs.height_m)) {
    return absl::InvalidArgumentError("crs: found a height of the geoid that is not finite, expected metres");
  }
  return absl::OkStatus();
}

}  // namespace

Status Frame::OpenSystem() {
  TESSERA_ASSIGN_OR_RETURN(ReferenceSystem system, ReferenceSystem::Of(crs_));
  TESSERA_RETURN_IF_ERROR(system.Locate(origin_.cwiseQuotient(system.units_m())));
  system_ = std::make_shared<const ReferenceSystem>(std::move(system));
  return absl::OkStatus();
}

Frame Frame::Of(const Crs& crs, const Eigen::Vector3d& origin_in_scene,
                const Eigen::Matrix3d& rotation_local_from_scene) {
  Frame frame;
  frame.crs_ = crs;
  frame.origin_ = origin_in_scene;
  frame.rotation_ = rotation_local_from_scene;
  // Only GeodeticFromLocal needs the system, and reports why it is missing.
  if (crs.kind == Crs::Kind::kProjected) frame.OpenSystem().IgnoreError();
  return frame;
}

StatusOr<Frame> Frame::Around(const Crs& crs, const Eigen::Vector3d& point_in_scene) {
  TESSERA_RETURN_IF_ERROR(CheckCrs(crs));
  if (!point_in_scene.allFinite())
    return absl::InvalidArgumentError("crs: found scene coordinates that are not finite");
  Frame frame;
  frame.crs_ = crs;
  frame.origin_ = RoundToGrid(point_in_scene);
  if (crs.kind == Crs::Kind::kLocal) return frame;
  if (crs.kind == Crs::Kind::kEcef) {
    const double radius = point_in_scene.norm();
    if (!(radius > 6.2e6 && radius < 6.6e6)) {
      return absl::InvalidArgumentError(absl::StrCat("crs: found a scene ", radius / 1000,
                                                     " km from the Earth's centre, expected 6200 to 6600 km for type "
                                                     "'ecef': check the type of crs"));
    }
    double lat_deg = 0, lon_deg = 0, height_m = 0;
    std::vector<double> ecef_from_enu;  // row-major
    GeographicLib::Geocentric::WGS84().Reverse(frame.origin_.x(), frame.origin_.y(), frame.origin_.z(), lat_deg,
                                               lon_deg, height_m);
    ecef_from_enu.resize(9);
    double x, y, z;
    GeographicLib::Geocentric::WGS84().Forward(lat_deg, lon_deg, height_m, x, y, z, ecef_from_enu);
    frame.rotation_ = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(ecef_from_enu.data()).transpose();
    return frame;
  }
  if (crs.kind == Crs::Kind::kProjected) TESSERA_RETURN_IF_ERROR(frame.OpenSystem());
  // Reject coordinates outside the coordinate system now: the report converts them only after all computations.
  const StatusOr<Eigen::Vector3d> geodetic = frame.GeodeticFromLocal(frame.LocalFromScene(point_in_scene));
  if (!geodetic.ok()) return geodetic.status();
  return frame;
}

StatusOr<Eigen::Vector3d> Frame::GeodeticFromLocal(const Eigen::Vector3d& p_local) const {
  const Eigen::Vector3d p = SceneFromLocal(p_local);
  if (crs_.kind == Crs::Kind::kProjected) {
    if (system_ == nullptr) {
      Frame other = *this;
      const Status why = other.OpenSystem();
      return why.ok() ? other.GeodeticFromLocal(p_local) : why;
    }
    Eigen::Vector3d geodetic = p.cwiseQuotient(system_->units_m());
    TESSERA_RETURN_IF_ERROR(system_->ToGeodetic({&geodetic, 1}));
    return geodetic;
  }
  double lat_deg = 0, lon_deg = 0, height_m = 0;
  try {
    switch (crs_.kind) {
      case Crs::Kind::kLocal:
        return absl::FailedPreconditionError("scene is not georeferenced: set `crs` in scene.json");
      case Crs::Kind::kEnu: {
        const GeographicLib::LocalCartesian enu(crs_.lat_rad * kDegreesPerRadian, crs_.lon_rad * kDegreesPerRadian,
                                                crs_.height_m);
        enu.Reverse(p.x(), p.y(), p.z(), lat_deg, lon_deg, height_m);
        break;
      }
      case Crs::Kind::kUtm:
        GeographicLib::UTMUPS::Reverse(crs_.zone, crs_.north, p.x(), p.y(), lat_deg, lon_deg);
        height_m = p.z();
        break;
      case Crs::Kind::kEcef:
        GeographicLib::Geocentric::WGS84().Reverse(p.x(), p.y(), p.z(), lat_deg, lon_deg, height_m);
        break;
      case Crs::Kind::kProjected:
        break;  // above
    }
  } catch (const GeographicLib::GeographicErr& error) {
    return absl::InvalidArgumentError(absl::StrCat("crs: coordinates (", p.x(), ", ", p.y(),
                                                   ") are outside the scene's coordinate system: ", error.what()));
  }
  return Geodetic(lat_deg, lon_deg, height_m);
}

}  // namespace tessera
