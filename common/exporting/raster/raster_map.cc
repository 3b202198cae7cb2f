#include "common/exporting/raster/raster_map.h"

#include <proj.h>
#include <proj_experimental.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <optional>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/geodesy/proj_objects.h"
#include "common/geodesy/reference_system.h"

namespace tessera {
namespace {

constexpr double kFinestPixel_gsd = 0.25, kCoarsestPixel_gsd = 256;

// The nearest of 1, 2, 2.5 and 5 times a power of ten, by ratio.
double RasterNiceSize(double size) {
  const double power = std::pow(10, std::floor(std::log10(size)));
  double best = power;
  for (const double factor : {2.0, 2.5, 5.0, 10.0}) {
    const double nice = factor * power;
    if (std::abs(std::log(nice / size)) < std::abs(std::log(best / size))) best = nice;
  }
  return best;
}

double RasterThreeDigits(double size) {
  const double power = std::pow(10, std::floor(std::log10(size)) - 2);
  return std::round(size / power) * power;
}

// The system of the scene's own coordinates, as ReferenceSystem::Parse reads it; empty: none.
std::string RasterSceneSystem(const Crs& crs) {
  switch (crs.kind) {
    case Crs::Kind::kUtm:
      return absl::StrCat("EPSG:", (crs.north ? 32600 : 32700) + crs.zone);
    case Crs::Kind::kEcef:
      return "EPSG:4978";
    case Crs::Kind::kProjected:
      return crs.vertical_epsg == 0 ? absl::StrCat("EPSG:", crs.epsg)
                                    : absl::StrCat("EPSG:", crs.epsg, "+", crs.vertical_epsg);
    case Crs::Kind::kEnu: {
      constexpr double kDegreesPerRadian = 180 / std::numbers::pi;
      return absl::StrFormat("ENU:%.10g,%.10g,%.10g", crs.lat_rad * kDegreesPerRadian, crs.lon_rad * kDegreesPerRadian,
                             crs.height_m);
    }
    case Crs::Kind::kLocal:
      break;
  }
  return "";
}

std::string RasterWkt(pj_ctx* context, const PJconsts* crs, PJ_WKT_TYPE type) {
  const char* const options[] = {"MULTILINE=NO", nullptr};
  const char* const text = crs == nullptr ? nullptr : proj_as_wkt(context, crs, type, options);
  return text == nullptr ? "" : text;
}

// The codes and definitions of a geographic or projected system.
Status DescribeRasterSystem(const std::string& text, RasterSystem* system) {
  TESSERA_ASSIGN_OR_RETURN(const std::unique_ptr<ProjContext> context, ProjContext::Make());
  pj_ctx* const c = context->get();
  const bool is_proj_string = absl::StrContains(text, "+proj=") || absl::StrContains(text, "+init=");
  ProjObject whole =
      context->Create(is_proj_string && !absl::StrContains(text, "+type=") ? absl::StrCat(text, " +type=crs") : text);
  if (whole == nullptr) return absl::InternalError(absl::StrCat("PROJ: ", context->TakeMessage()));
  ProjObject plan, vertical;
  if (proj_get_type(whole.get()) == PJ_TYPE_COMPOUND_CRS) {
    plan.reset(proj_crs_get_sub_crs(c, whole.get(), 0));
    vertical.reset(proj_crs_get_sub_crs(c, whole.get(), 1));
  } else {
    // Readers of rasters expect a system of the plan, such as EPSG:4326 for EPSG:4979.
    ProjObject flat(proj_crs_demote_to_2D(c, nullptr, whole.get()));
    if (flat != nullptr) whole = std::move(flat);
    plan.reset(proj_clone(c, whole.get()));
  }
  constexpr int kLargestGeoKey = 32766;
  const auto code = [&](const ProjObject& crs) {
    const ProjObject base = crs == nullptr ? nullptr : ProjBaseOf(c, crs.get());
    const int epsg = base == nullptr ? 0 : ProjEpsgOf(c, base.get());
    return epsg <= kLargestGeoKey ? epsg : 0;
  };
  system->epsg = code(plan);
  system->vertical_epsg = code(vertical);
  system->wkt = RasterWkt(c, whole.get(), PJ_WKT1_GDAL);
  if (system->wkt.empty()) system->wkt = RasterWkt(c, whole.get(), PJ_WKT2_2019);
  if (system->epsg == 0) system->esri_wkt = RasterWkt(c, plan.get(), PJ_WKT1_ESRI);
  return absl::OkStatus();
}

// The UTM zone of a place on the globe, as an advice.
std::string RasterUtmAdvice(const Frame& frame) {
  const StatusOr<Eigen::Vector3d> place = frame.GeodeticFromLocal(Eigen::Vector3d::Zero());
  if (!place.ok()) return "EPSG:32633";
  const int zone = std::clamp(static_cast<int>(std::floor((place->y() * 180 / std::numbers::pi + 180) / 6)) + 1, 1, 60);
  return absl::StrCat("EPSG:", (place->x() >= 0 ? 32600 : 32700) + zone);
}

}  // namespace

StatusOr<RasterMap> RasterMap::Open(const ExportScene& scene, const ExportOptions& options) {
  TESSERA_ASSIGN_OR_RETURN(ExportMap opened, ExportMap::Open(scene, options.crs));
  RasterMap map(std::move(opened));
  const bool is_scene = map.map_.crs().empty();
  const std::string text = is_scene ? RasterSceneSystem(scene.frame.crs()) : map.map_.crs();
  TESSERA_ASSIGN_OR_RETURN(const ReferenceSystem reference, ReferenceSystem::Parse(text));
  using Kind = ReferenceSystem::Kind;
  if (reference.kind() == Kind::kGeocentric) {
    return absl::InvalidArgumentError(absl::StrCat("crs: found ", reference.name(),
                                                   ", a geocentric system, in which no raster can be written, expected "
                                                   "a projected system, such as ",
                                                   RasterUtmAdvice(scene.frame), ": give it with --crs"));
  }
  RasterSystem& system = map.system_;
  system.name = reference.kind() == Kind::kLocal ? "local coordinates of the scene" : reference.name();
  system.unit_m = reference.units_m().x();
  system.height_unit_m = reference.units_m().z();
  if (is_scene) map.metres_per_coordinate_ = reference.units_m();
  if (reference.kind() == Kind::kProjected || reference.kind() == Kind::kGeographic) {
    system.kind =
        reference.kind() == Kind::kProjected ? RasterSystem::Kind::kProjected : RasterSystem::Kind::kGeographic;
    TESSERA_RETURN_IF_ERROR(DescribeRasterSystem(text, &system));
  }
  if (scene.frame.crs().kind == Crs::Kind::kLocal) {
    map.turn_.row(0) = scene.ground.axis_x;
    map.turn_.row(1) = scene.ground.axis_y;
    map.turn_.row(2) = scene.up;
  }
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  TESSERA_RETURN_IF_ERROR(map.FromLocal({&origin, 1}));
  map.reference_height_ = origin.z();
  TESSERA_RETURN_IF_ERROR(map.ChoosePixelSize(scene, options.gsd_m));
  return map;
}

Status RasterMap::ChoosePixelSize(const ExportScene& scene, double gsd_m) {
  const double finest_m = kFinestPixel_gsd * scene.gsd_m, coarsest_m = kCoarsestPixel_gsd * scene.gsd_m;
  if (gsd_m != 0 && !(gsd_m >= finest_m && gsd_m <= coarsest_m)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("gsd: found %g m for a scene whose images have %.3g m per pixel, expected %.3g to %.3g m",
                        gsd_m, scene.gsd_m, finest_m, coarsest_m));
  }
  if (!system_.in_degrees()) {
    const double size = gsd_m == 0 ? RasterNiceSize(scene.gsd_m / system_.unit_m) : gsd_m / system_.unit_m;
    pixel_size_.setConstant(size);
    pixel_m_ = size * system_.unit_m;
    return absl::OkStatus();
  }
  constexpr double kStep_deg = 1e-4;
  pixel_m_ = gsd_m == 0 ? RasterNiceSize(scene.gsd_m) : gsd_m;
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  TESSERA_RETURN_IF_ERROR(FromLocal({&origin, 1}));
  for (int k = 0; k < 2; ++k) {
    Eigen::Vector3d beside = origin + kStep_deg * Eigen::Vector3d::Unit(k);
    TESSERA_RETURN_IF_ERROR(ToLocal({&beside, 1}));
    pixel_size_[k] = RasterThreeDigits(pixel_m_ * kStep_deg / beside.norm());
  }
  return absl::OkStatus();
}

Status RasterMap::FromLocal(std::span<Eigen::Vector3d> points) const {
  TESSERA_RETURN_IF_ERROR(map_.FromLocal(points));
  for (Eigen::Vector3d& p : points) p = (turn_ * p).cwiseQuotient(metres_per_coordinate_);
  return absl::OkStatus();
}

Status RasterMap::ToLocal(std::span<Eigen::Vector3d> points) const {
  for (Eigen::Vector3d& p : points) p = turn_.transpose() * p.cwiseProduct(metres_per_coordinate_);
  return map_.ToLocal(points);
}

}  // namespace tessera
