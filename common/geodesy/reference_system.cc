#include "common/geodesy/reference_system.h"

#include <proj.h>
#include <proj_experimental.h>

#include <GeographicLib/Geocentric.hpp>
#include <GeographicLib/LocalCartesian.hpp>
#include <charconv>
#include <cmath>
#include <mutex>
#include <numbers>
#include <string_view>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "common/geodesy/proj_objects.h"

namespace tessera {
namespace {

constexpr double kDegreesPerRad = 180 / std::numbers::pi;
constexpr size_t kMaxTextBytes = 65536;
constexpr double kPoorAccuracy_m = 1;
constexpr char kExpected[] =
    "EPSG:H or EPSG:H+V, ENU:LAT,LON[,H], local, or the WKT or PROJ string of a projected, geographic or geocentric "
    "system";

std::string ExcerptOf(const std::string& text) { return text.size() <= 80 ? text : text.substr(0, 77) + "..."; }

Status CrsError(const std::string& text, const std::string& why, const std::string& expected) {
  return absl::InvalidArgumentError(absl::StrCat("crs: found '", ExcerptOf(text), "'", why.empty() ? "" : " (", why,
                                                 why.empty() ? "" : ")", ", expected ", expected));
}

// ENU:LAT,LON[,H], after the colon.
StatusOr<Crs> ParseEnu(const std::string& text, std::string_view numbers) {
  double values[3] = {0, 0, 0};
  int count = 0;
  bool good = true;
  for (const char *at = numbers.data(), *const end = at + numbers.size(); good && count < 3;) {
    while (at < end && *at == ' ') ++at;
    const auto [stop, error] = std::from_chars(at, end, values[count]);
    good = error == std::errc() && std::isfinite(values[count]);
    ++count;
    at = stop;
    while (at < end && *at == ' ') ++at;
    if (at == end) break;
    good = good && *at++ == ',' && count < 3;
  }
  if (!good || count < 2 || std::abs(values[0]) > 90 || std::abs(values[1]) > 360) {
    return CrsError(text, "", "ENU:LAT,LON or ENU:LAT,LON,H in degrees and metres, such as ENU:48.85,2.35,60");
  }
  Crs crs;
  crs.kind = Crs::Kind::kEnu;
  crs.lat_rad = values[0] * (std::numbers::pi / 180);  // as scene.json is read, so that both are equal
  crs.lon_rad = values[1] * (std::numbers::pi / 180);
  crs.height_m = values[2];
  return crs;
}

std::string GridAdvice(const std::set<std::string>& grids) {
  return absl::StrCat(absl::StrJoin(grids, ", "),
                      " (PROJ's grids: https://cdn.proj.org; copy them to its data folder)");
}

std::string AccuracyText(double accuracy_m) {
  return accuracy_m < 0 ? std::string("unknown accuracy") : absl::StrCat("an accuracy of ", accuracy_m, " m");
}

Eigen::Vector2d LonLatOfDegrees(const Eigen::Vector3d& image) { return image.head<2>(); }
Eigen::Vector2d LonLatOfGeocentric(const Eigen::Vector3d& image) {
  const Eigen::Vector3d geodetic = GeodeticFromGeocentric(image);
  return {geodetic.y() * kDegreesPerRad, geodetic.x() * kDegreesPerRad};
}

}  // namespace

struct ReferenceSystem::Impl {
  Kind kind = Kind::kLocal;
  std::string text, name = "local";
  Eigen::Vector3d units_m = Eigen::Vector3d::Ones();
  HeightOptions heights;
  Crs enu;
  int epsg = 0, vertical_epsg = 0;
  std::string vertical_name;  // empty: no vertical datum is named
  double accuracy_m = 0;
  Warnings warnings;
  std::vector<std::string> conventions;
  mutable std::mutex mutex;              // PROJ's objects serve one call at a time
  std::unique_ptr<ProjContext> context;  // before its objects, which are deleted first
  ProjObject horizontal, vertical;       // plan (two axes, or geocentric); vertical datum
  ProjOperation plan, height;            // to longitude, latitude in degrees (or geocentric); (lon, lat, z) to height

  Status ReadProj();
  Status ReadPlan(ProjObject crs);
  Status ReadVertical();
  Status Choose(const Eigen::Vector3d& near, bool near_is_geodetic);
  Status ChoosePlan(const Eigen::Vector3d& near, bool near_is_image, Eigen::Vector3d* image);
  void ChooseHeight(const Eigen::Vector3d& lon_lat_z);
  double HeightAt(const Eigen::Vector3d& lon_lat_z) const;
  Eigen::Vector3d ToGeodetic(const Eigen::Vector3d& p) const;
  Eigen::Vector3d FromGeodetic(const Eigen::Vector3d& geodetic) const;
  // Replaces each point by `convert(frame of kEnu, point)`. `name_point`: of one that cannot be converted.
  template <class Convert, class NamePoint>
  Status ConvertEach(std::span<Eigen::Vector3d> points, const Convert& convert, const NamePoint& name_point) const;
};

Status ReferenceSystem::Impl::ReadProj() {
  TESSERA_ASSIGN_OR_RETURN(context, ProjContext::Make());
  pj_ctx* const c = context->get();
  const bool is_proj_string = absl::StrContains(text, "+proj=") || absl::StrContains(text, "+init=");
  ProjObject whole =
      context->Create(is_proj_string && !absl::StrContains(text, "+type=") ? absl::StrCat(text, " +type=crs") : text);
  if (whole == nullptr || !proj_is_crs(whole.get())) {
    return CrsError(text, whole == nullptr ? context->TakeMessage() : "no reference system", kExpected);
  }
  if (proj_get_name(whole.get()) != nullptr) name = proj_get_name(whole.get());
  if (name.empty() || name == "unknown" || name == "unnamed") name = ExcerptOf(text);
  if (proj_get_type(whole.get()) == PJ_TYPE_COMPOUND_CRS) {
    TESSERA_RETURN_IF_ERROR(ReadPlan(ProjObject(proj_crs_get_sub_crs(c, whole.get(), 0))));
    vertical.reset(proj_crs_get_sub_crs(c, whole.get(), 1));
    TESSERA_RETURN_IF_ERROR(ReadVertical());
  } else {
    TESSERA_RETURN_IF_ERROR(ReadPlan(std::move(whole)));
  }
  if (epsg > 0) {
    absl::StrAppend(&name, " (EPSG:", epsg);
    if (vertical_epsg > 0) absl::StrAppend(&name, "+", vertical_epsg);
    absl::StrAppend(&name, ")");
  }
  return absl::OkStatus();
}

Status ReferenceSystem::Impl::ReadPlan(ProjObject crs) {
  pj_ctx* const c = context->get();
  const ProjObject base = crs == nullptr ? nullptr : ProjBaseOf(c, crs.get());
  const std::vector<ProjAxis> axes = ProjAxesOf(c, base.get());
  const PJ_TYPE type = base == nullptr ? PJ_TYPE_UNKNOWN : proj_get_type(base.get());
  switch (type) {
    case PJ_TYPE_GEOCENTRIC_CRS:
      kind = Kind::kGeocentric;
      break;
    case PJ_TYPE_GEOGRAPHIC_2D_CRS:
    case PJ_TYPE_GEOGRAPHIC_3D_CRS:
      kind = Kind::kGeographic;
      break;
    case PJ_TYPE_PROJECTED_CRS:
      kind = Kind::kProjected;
      break;
    case PJ_TYPE_ENGINEERING_CRS:
      kind = Kind::kLocal;
      break;
    default:
      return CrsError(text, "a system of another type", kExpected);
  }
  if (axes.size() < 2 && kind != Kind::kLocal) return CrsError(text, "a system without axes", kExpected);
  if (kind != Kind::kGeographic && !axes.empty()) units_m.setConstant(axes[0].unit);
  if (axes.size() == 3) units_m.z() = axes[2].unit;
  if (kind == Kind::kGeocentric && units_m != Eigen::Vector3d::Ones()) {
    return CrsError(text, "geocentric coordinates in other units", "geocentric coordinates in metres");
  }
  if (kind != Kind::kGeographic && units_m.x() != 1) {
    warnings.push_back(absl::StrCat(name, ": coordinates are in ", axes[0].unit_name, " (",
                                    absl::StrFormat("%.10g", units_m.x()), " m); they are converted to metres"));
  }
  if (kind == Kind::kProjected) epsg = ProjEpsgOf(c, base.get());
  if (axes.size() == 3 && (kind == Kind::kProjected || kind == Kind::kGeographic)) {
    crs.reset(proj_crs_demote_to_2D(c, nullptr, crs.get()));
    if (crs == nullptr) return CrsError(text, context->TakeMessage(), kExpected);
  }
  horizontal = std::move(crs);
  return absl::OkStatus();
}

Status ReferenceSystem::Impl::ReadVertical() {
  pj_ctx* const c = context->get();
  const ProjObject base = vertical == nullptr ? nullptr : ProjBaseOf(c, vertical.get());
  const std::vector<ProjAxis> axes = ProjAxesOf(c, base.get());
  if (axes.size() != 1) return CrsError(text, "a vertical system without an axis", kExpected);
  vertical_name = proj_get_name(base.get());
  vertical_epsg = ProjEpsgOf(c, base.get());
  if (axes[0].direction != "up") {
    return CrsError(text, absl::StrCat("the axis of ", vertical_name, " points ", axes[0].direction),
                    "a vertical system with heights, not depths");
  }
  units_m.z() = axes[0].unit;
  if (units_m.z() != 1) {
    warnings.push_back(absl::StrCat(vertical_name, ": heights are in ", axes[0].unit_name, " (",
                                    absl::StrFormat("%.10g", units_m.z()), " m); they are converted to metres"));
  }
  return absl::OkStatus();
}

Status ReferenceSystem::Impl::ChoosePlan(const Eigen::Vector3d& near, bool near_is_image, Eigen::Vector3d* image) {
  const bool geocentric = kind == Kind::kGeocentric;
  const ProjObject wgs84 = context->Create(geocentric ? "EPSG:4978" : "EPSG:4326");
  if (wgs84 == nullptr) return absl::InternalError(absl::StrCat("PROJ: ", context->TakeMessage()));
  const Eigen::Vector3d place = geocentric ? near : Eigen::Vector3d(near.x(), near.y(), 0);
  plan = ChooseOperation(*context, horizontal.get(), wgs84.get(), place, near_is_image,
                         geocentric ? LonLatOfGeocentric : LonLatOfDegrees);
  if (plan.object == nullptr && !plan.better_grids.empty()) {
    return absl::InvalidArgumentError(absl::StrCat("crs: found ", name, ", whose transformation to WGS 84 needs ",
                                                   plan.better_grids.size() == 1 ? "a grid" : "grids",
                                                   " that PROJ lacks here, expected ", GridAdvice(plan.better_grids)));
  }
  if (plan.object == nullptr) {
    const std::string message = context->TakeMessage();
    return absl::InvalidArgumentError(
        absl::StrCat("crs: found coordinates (", near.x(), ", ", near.y(), ", ", near.z(), ") ",
                     near_is_image ? "of WGS 84 for " : "in ", name, ", for which PROJ has no transformation to WGS 84",
                     message.empty() ? "" : " (", message, message.empty() ? "" : ")",
                     ", expected coordinates inside the system's domain, or another system: give it with --crs; "
                     "--crs local keeps the coordinates without a place on Earth"));
  }
  *image = near_is_image ? place : Transform(plan, true, place);
  accuracy_m = plan.accuracy_m;
  conventions.push_back(absl::StrCat("coordinates are in ", name, "; PROJ's operation to WGS 84: ", plan.name, ", ",
                                     AccuracyText(accuracy_m)));
  if (accuracy_m < 0 || accuracy_m > kPoorAccuracy_m) {
    std::string warning = absl::StrCat(name, ": its transformation to WGS 84 has ", AccuracyText(accuracy_m),
                                       ": the place on Earth may be off, coordinates in the system are not");
    if (!plan.better_grids.empty()) {
      absl::StrAppend(&warning, "; a better one needs ", GridAdvice(plan.better_grids));
    }
    warnings.push_back(warning);
  }
  if (!plan.covers) {
    const Eigen::Vector2d at = geocentric ? LonLatOfGeocentric(*image) : LonLatOfDegrees(*image);
    warnings.push_back(absl::StrCat(name, ": the coordinates lie at latitude ", at.y(), ", longitude ", at.x(),
                                    ", outside the area where the system is used: check --crs"));
  }
  return absl::OkStatus();
}

void ReferenceSystem::Impl::ChooseHeight(const Eigen::Vector3d& lon_lat_z) {
  if (heights.geoid_height_m) {
    conventions.push_back(
        absl::StrCat("heights plus ", *heights.geoid_height_m, " m are heights above the WGS 84 ellipsoid, as stated"));
    return;
  }
  if (vertical == nullptr || heights.ellipsoid) {
    conventions.push_back(absl::StrCat("heights are taken as above the WGS 84 ellipsoid",
                                       vertical == nullptr ? ": the system names no vertical datum" : ", as stated"));
    return;
  }
  pj_ctx* const c = context->get();
  const ProjObject flat = context->Create("EPSG:4326"), ellipsoid = context->Create("EPSG:4979");
  const ProjObject compound(
      flat == nullptr ? nullptr : proj_create_compound_crs(c, "WGS 84 + height", flat.get(), vertical.get()));
  if (compound != nullptr && ellipsoid != nullptr) {
    height = ChooseOperation(*context, compound.get(), ellipsoid.get(), lon_lat_z, false,
                             [&](const Eigen::Vector3d&) { return Eigen::Vector2d(lon_lat_z.head<2>()); });
  }
  // The geoid of another country would give heights, but wrong ones.
  if (!height.covers) height.object.reset();
  if (height.object != nullptr) {
    conventions.push_back(absl::StrCat("heights above ", vertical_name, " are converted to the WGS 84 ellipsoid: ",
                                       height.name, ", ", AccuracyText(height.accuracy_m)));
    return;
  }
  conventions.push_back(absl::StrCat("heights above ", vertical_name, " are kept as they are"));
  std::string warning = absl::StrCat(
      vertical_name,
      ": its heights cannot be converted here and are kept, as if they were above the WGS 84 ellipsoid: "
      "the result may lie up to 100 m above or below its place on the globe; in the source's system its heights are "
      "right. Give --geoid-height M, or --heights ellipsoid if heights are above the ellipsoid");
  if (!height.better_grids.empty()) absl::StrAppend(&warning, ", or install ", GridAdvice(height.better_grids));
  warnings.push_back(warning);
}

// `lon_lat_z`: degrees and the system's height. Metres above the ellipsoid.
double ReferenceSystem::Impl::HeightAt(const Eigen::Vector3d& lon_lat_z) const {
  if (height.object != nullptr) return Transform(height, true, lon_lat_z).z();
  return lon_lat_z.z() * units_m.z() + heights.geoid_height_m.value_or(0);
}

Eigen::Vector3d ReferenceSystem::Impl::ToGeodetic(const Eigen::Vector3d& p) const {
  if (kind == Kind::kGeocentric) return GeodeticFromGeocentric(Transform(plan, true, p));
  const Eigen::Vector3d lon_lat = Transform(plan, true, {p.x(), p.y(), 0});
  return {lon_lat.y() / kDegreesPerRad, lon_lat.x() / kDegreesPerRad, HeightAt({lon_lat.x(), lon_lat.y(), p.z()})};
}

// PROJ's inverse of a datum shift is not exact to 1e-6 m, because it drops the height that the shift adds. So the
// argument is corrected by what the forward operation says.
Eigen::Vector3d ReferenceSystem::Impl::FromGeodetic(const Eigen::Vector3d& geodetic) const {
  constexpr int kMaxRounds = 8;
  const bool geocentric = kind == Kind::kGeocentric;
  Eigen::Vector3d target(geodetic.y() * kDegreesPerRad, geodetic.x() * kDegreesPerRad, 0);
  if (geocentric) target = GeocentricFromGeodetic(geodetic);
  const double tolerance = geocentric ? 1e-8 : 1e-13;  // metres; degrees
  Eigen::Vector3d argument = target, p = target;
  for (int round = 0; round < kMaxRounds; ++round) {
    p = Transform(plan, false, argument);
    Eigen::Vector3d error = target - Transform(plan, true, p);
    if (!geocentric) error = {std::remainder(error.x(), 360), error.y(), 0};
    if (!(error.cwiseAbs().maxCoeff() > tolerance)) break;
    argument += error;
  }
  if (geocentric) return p;
  p.z() = (geodetic.z() - heights.geoid_height_m.value_or(0)) / units_m.z();
  for (int round = 0; round < kMaxRounds && height.object != nullptr; ++round) {
    const double error_m = geodetic.z() - HeightAt({target.x(), target.y(), p.z()});
    if (!(std::abs(error_m) > 1e-9)) break;
    p.z() += error_m / units_m.z();
  }
  return p;
}

ReferenceSystem::ReferenceSystem(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ReferenceSystem::ReferenceSystem(ReferenceSystem&&) noexcept = default;
ReferenceSystem& ReferenceSystem::operator=(ReferenceSystem&&) noexcept = default;
ReferenceSystem::~ReferenceSystem() = default;

ReferenceSystem::Kind ReferenceSystem::kind() const { return impl_->kind; }
const std::string& ReferenceSystem::name() const { return impl_->name; }
const Eigen::Vector3d& ReferenceSystem::units_m() const { return impl_->units_m; }
double ReferenceSystem::accuracy_m() const { return impl_->accuracy_m; }
const Warnings& ReferenceSystem::warnings() const { return impl_->warnings; }
const std::vector<std::string>& ReferenceSystem::conventions() const { return impl_->conventions; }

StatusOr<ReferenceSystem> ReferenceSystem::Parse(const std::string& text, const HeightOptions& heights) {
  auto impl = std::make_unique<Impl>();
  impl->heights = heights;
  if (text.size() > kMaxTextBytes || text.find('\0') != std::string::npos) {
    return CrsError(text.substr(0, 40), absl::StrCat(text.size(), " bytes"), "a text of at most 65536 bytes");
  }
  impl->text = std::string(absl::StripAsciiWhitespace(text));
  if (impl->text.empty() || absl::EqualsIgnoreCase(impl->text, "local")) return ReferenceSystem(std::move(impl));
  if (absl::StartsWithIgnoreCase(impl->text, "ENU:")) {
    TESSERA_ASSIGN_OR_RETURN(impl->enu, ParseEnu(impl->text, std::string_view(impl->text).substr(4)));
    impl->kind = Kind::kEnu;
    impl->name = impl->text;
    return ReferenceSystem(std::move(impl));
  }
  TESSERA_RETURN_IF_ERROR(impl->ReadProj());
  return ReferenceSystem(std::move(impl));
}

StatusOr<ReferenceSystem> ReferenceSystem::Of(const Crs& crs) {
  switch (crs.kind) {
    case Crs::Kind::kLocal:
      return Parse("");
    case Crs::Kind::kEnu: {
      auto impl = std::make_unique<Impl>();
      impl->kind = Kind::kEnu;
      impl->enu = crs;
      impl->name = "east-north-up";
      return ReferenceSystem(std::move(impl));
    }
    case Crs::Kind::kUtm:
      return Parse(absl::StrCat("EPSG:", (crs.north ? 32600 : 32700) + crs.zone));
    case Crs::Kind::kEcef:
      return Parse("EPSG:4978");
    case Crs::Kind::kProjected:
      break;
  }
  HeightOptions heights;
  if (crs.height_m != 0) heights.geoid_height_m = crs.height_m;
  std::string text = absl::StrCat("EPSG:", crs.epsg);
  if (crs.vertical_epsg != 0) absl::StrAppend(&text, "+", crs.vertical_epsg);
  TESSERA_ASSIGN_OR_RETURN(ReferenceSystem system, Parse(text, heights));
  if (system.kind() != Kind::kProjected) return CrsError(text, system.name(), "the EPSG code of a projected system");
  return system;
}

Status ReferenceSystem::Impl::Choose(const Eigen::Vector3d& near, bool near_is_geodetic) {
  const std::lock_guard<std::mutex> lock(mutex);
  if (kind == Kind::kLocal) return absl::OkStatus();
  if (!near.allFinite()) return absl::InvalidArgumentError("crs: found coordinates that are not finite");
  if (kind == Kind::kEnu) {
    conventions.push_back(absl::StrCat("coordinates are metres east, north and up of a WGS 84 origin, ", name));
    return absl::OkStatus();
  }
  Eigen::Vector3d place = near, image;
  if (near_is_geodetic) {
    place = kind == Kind::kGeocentric ? GeocentricFromGeodetic(near)
                                      : Eigen::Vector3d(near.y() * kDegreesPerRad, near.x() * kDegreesPerRad, near.z());
  }
  TESSERA_RETURN_IF_ERROR(ChoosePlan(place, near_is_geodetic, &image));
  if (kind != Kind::kGeocentric) ChooseHeight({image.x(), image.y(), near_is_geodetic ? 0 : near.z()});
  // Far outside their domain, projections fold.
  const Eigen::Vector3d source = near_is_geodetic ? FromGeodetic(near) : near;
  const Eigen::Vector3d geodetic = ToGeodetic(source), back = FromGeodetic(geodetic);
  if (!(std::abs(geodetic.x()) <= std::numbers::pi / 2) || !((back - source).cwiseAbs().maxCoeff() < 0.01)) {
    return absl::InvalidArgumentError(absl::StrCat("crs: found coordinates (", source.x(), ", ", source.y(), ", ",
                                                   source.z(), "), which are outside the domain of ", name,
                                                   ", expected coordinates in this system"));
  }
  return absl::OkStatus();
}

Status ReferenceSystem::Locate(const Eigen::Vector3d& near) { return impl_->Choose(near, false); }
Status ReferenceSystem::LocateGeodetic(const Eigen::Vector3d& near) { return impl_->Choose(near, true); }

std::optional<Crs> ReferenceSystem::GridCrs() const {
  if (impl_->kind == Kind::kLocal) return Crs();
  if (impl_->kind == Kind::kEnu) return impl_->enu;
  if (impl_->kind != Kind::kProjected || impl_->epsg == 0) return std::nullopt;
  Crs crs;
  const HeightOptions& heights = impl_->heights;
  const bool on_ellipsoid = impl_->vertical == nullptr || heights.ellipsoid || heights.geoid_height_m == 0.0;
  if (!on_ellipsoid && impl_->vertical_epsg == 0 && !heights.geoid_height_m) return std::nullopt;
  crs.height_m = heights.geoid_height_m.value_or(0);
  crs.vertical_epsg = on_ellipsoid ? 0 : impl_->vertical_epsg;
  const int zone = impl_->epsg % 100, series = impl_->epsg - zone;
  if ((series == 32600 || series == 32700) && zone >= 1 && zone <= 60 && crs.vertical_epsg == 0 && crs.height_m == 0) {
    crs.kind = Crs::Kind::kUtm;
    crs.zone = zone;
    crs.north = series == 32600;
  } else {
    crs.kind = Crs::Kind::kProjected;
    crs.epsg = impl_->epsg;
  }
  return crs;
}

template <class Convert, class NamePoint>
Status ReferenceSystem::Impl::ConvertEach(std::span<Eigen::Vector3d> points, const Convert& convert,
                                          const NamePoint& name_point) const {
  if (kind == Kind::kLocal) return absl::FailedPreconditionError("crs: local coordinates have no place on Earth");
  const std::lock_guard<std::mutex> lock(mutex);
  const GeographicLib::LocalCartesian frame(enu.lat_rad * kDegreesPerRad, enu.lon_rad * kDegreesPerRad, enu.height_m);
  for (Eigen::Vector3d& p : points) {
    const Eigen::Vector3d from = p;
    p = convert(frame, from);
    if (!p.allFinite()) return absl::InvalidArgumentError(absl::StrCat("crs: found ", name_point(from)));
  }
  return absl::OkStatus();
}

Status ReferenceSystem::ToGeodetic(std::span<Eigen::Vector3d> points) const {
  const auto convert = [&](const GeographicLib::LocalCartesian& frame, const Eigen::Vector3d& from) {
    if (impl_->kind != Kind::kEnu) return impl_->ToGeodetic(from);
    Eigen::Vector3d p;
    frame.Reverse(from.x(), from.y(), from.z(), p.x(), p.y(), p.z());
    p.head<2>() /= kDegreesPerRad;
    return p;
  };
  return impl_->ConvertEach(points, convert, [&](const Eigen::Vector3d& from) {
    return absl::StrCat("coordinates (", from.x(), ", ", from.y(), ", ", from.z(),
                        "), which PROJ cannot convert, expected coordinates in ", impl_->name);
  });
}

Status ReferenceSystem::FromGeodetic(std::span<Eigen::Vector3d> points) const {
  const auto convert = [&](const GeographicLib::LocalCartesian& frame, const Eigen::Vector3d& from) {
    if (impl_->kind != Kind::kEnu) return impl_->FromGeodetic(from);
    Eigen::Vector3d p;
    frame.Forward(from.x() * kDegreesPerRad, from.y() * kDegreesPerRad, from.z(), p.x(), p.y(), p.z());
    return p;
  };
  return impl_->ConvertEach(points, convert, [&](const Eigen::Vector3d& from) {
    return absl::StrCat("latitude ", from.x() * kDegreesPerRad, ", longitude ", from.y() * kDegreesPerRad,
                        ", which has no coordinates in ", impl_->name);
  });
}

Eigen::Vector3d GeocentricFromGeodetic(const Eigen::Vector3d& geodetic) {
  Eigen::Vector3d p;
  GeographicLib::Geocentric::WGS84().Forward(geodetic.x() * kDegreesPerRad, geodetic.y() * kDegreesPerRad, geodetic.z(),
                                             p.x(), p.y(), p.z());
  return p;
}

Eigen::Vector3d GeodeticFromGeocentric(const Eigen::Vector3d& geocentric) {
  double lat_deg = 0, lon_deg = 0, height_m = 0;
  GeographicLib::Geocentric::WGS84().Reverse(geocentric.x(), geocentric.y(), geocentric.z(), lat_deg, lon_deg,
                                             height_m);
  return {lat_deg / kDegreesPerRad, lon_deg / kDegreesPerRad, height_m};
}

}  // namespace tessera
