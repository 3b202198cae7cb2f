#include "common/importing/frames.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/importing/proof/residuals.h"

namespace tessera {
namespace {

using Kind = ReferenceSystem::Kind;

constexpr double kDegreesPerRadian = 180 / std::numbers::pi;

bool IsAngular(const ReferenceSystem& system) { return system.kind() == Kind::kGeographic; }

// About 10 m along each coordinate: rounding and curvature then change a direction by less than 1e-9.
Eigen::Vector3d JacobianStep(const ReferenceSystem& system) {
  constexpr double kStep_m = 10, kStepAngle = 1e-4;
  const Eigen::Vector3d step = kStep_m * system.units_m().cwiseInverse();
  return IsAngular(system) ? Eigen::Vector3d(kStepAngle, kStepAngle, step.z()) : step;
}

// Columns: the directions of the three coordinates at `point`, of unit length, by central differences of `map`.
template <class Map>
StatusOr<Eigen::Matrix3d> DirectionsAt(const Eigen::Vector3d& point, const Eigen::Vector3d& step, const Map& map) {
  std::array<Eigen::Vector3d, 6> around;
  for (int k = 0; k < 3; ++k) {
    around[2 * k] = point + step[k] * Eigen::Vector3d::Unit(k);
    around[2 * k + 1] = point - step[k] * Eigen::Vector3d::Unit(k);
  }
  TESSERA_RETURN_IF_ERROR(map(std::span<Eigen::Vector3d>(around)));
  Eigen::Matrix3d directions;
  for (int k = 0; k < 3; ++k) directions.col(k) = (around[2 * k] - around[2 * k + 1]).normalized();
  return directions;
}

// A left-handed system, such as one of southing and westing, would mirror the block.
Status CheckHandedness(const ReferenceSystem& system, const Eigen::Vector3d& point) {
  TESSERA_ASSIGN_OR_RETURN(const Eigen::Matrix3d directions,
                           DirectionsAt(point, JacobianStep(system), [&](std::span<Eigen::Vector3d> points) {
                             TESSERA_RETURN_IF_ERROR(system.ToGeodetic(points));
                             for (Eigen::Vector3d& p : points) p = GeocentricFromGeodetic(p);
                             return absl::OkStatus();
                           }));
  if (directions.determinant() > 0.5) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("crs: found ", system.name(),
                                                 ", whose axes are left-handed or not perpendicular, expected a system "
                                                 "with axes such as easting and northing"));
}

StatusOr<ReferenceSystem> OpenSource(const SourceCoordinates& source, const HeightOptions& heights,
                                     const Eigen::Vector3d& near) {
  TESSERA_ASSIGN_OR_RETURN(ReferenceSystem system, ReferenceSystem::Parse(source.crs, heights));
  TESSERA_RETURN_IF_ERROR(system.Locate(near + source.offset));
  if (system.kind() != Kind::kLocal) TESSERA_RETURN_IF_ERROR(CheckHandedness(system, near + source.offset));
  return system;
}

// East-north-up at the place of `geodetic`, at height 0. Rounded to 1e-6 degrees, so that scene.json is short.
Crs EnuAt(const Eigen::Vector3d& geodetic) {
  const auto rounded_rad = [](double angle_rad) {
    const double angle_deg = std::round(angle_rad * kDegreesPerRadian * 1e6) / 1e6;
    return angle_deg * (std::numbers::pi / 180);  // as scene.json is read
  };
  Crs crs;
  crs.kind = Crs::Kind::kEnu;
  crs.lat_rad = rounded_rad(geodetic.x());
  crs.lon_rad = rounded_rad(geodetic.y());
  return crs;
}

// Median of the poses' centres, else of the tie points.
Eigen::Vector3d CentreOf(const ImportedBlock& block) {
  std::vector<Eigen::Vector3d> positions;
  for (const BlockImage& image : block.images) {
    if (image.oriented) positions.push_back(image.centre);
  }
  for (size_t k = 0; k < block.points.size() && positions.empty(); ++k) positions.push_back(block.points[k].position);
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  if (positions.empty()) return centre;
  const auto middle = positions.begin() + static_cast<std::ptrdiff_t>(positions.size() / 2);
  for (int k = 0; k < 3; ++k) {
    std::nth_element(positions.begin(), middle, positions.end(),
                     [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b) { return a[k] < b[k]; });
    centre[k] = (*middle)[k];
  }
  return centre;
}

}  // namespace

SceneMap::SceneMap(ReferenceSystem source, std::optional<ReferenceSystem> target, const Crs& scene,
                   const Eigen::Vector3d& offset)
    : source_(std::move(source)), target_(std::move(target)), scene_(scene), offset_(offset) {}

StatusOr<SceneMap> SceneMap::Open(const SourceCoordinates& source, const Crs& scene, const HeightOptions& heights,
                                  const Eigen::Vector3d& near) {
  TESSERA_ASSIGN_OR_RETURN(ReferenceSystem system, OpenSource(source, heights, near));
  if (system.GridCrs() == scene) return SceneMap(std::move(system), std::nullopt, scene, source.offset);
  if (system.kind() == Kind::kLocal || scene.kind == Crs::Kind::kLocal) {
    return absl::InvalidArgumentError(absl::StrCat(
        "crs: found ", system.kind() == Kind::kLocal ? "a source without a coordinate system" : system.name(),
        " and a scene ", scene.kind == Crs::Kind::kLocal ? "without one" : "with one",
        ", expected a system for both or for none: give it with --crs"));
  }
  TESSERA_ASSIGN_OR_RETURN(ReferenceSystem target, ReferenceSystem::Of(scene));
  Eigen::Vector3d geodetic = near + source.offset;
  TESSERA_RETURN_IF_ERROR(system.ToGeodetic({&geodetic, 1}));
  TESSERA_RETURN_IF_ERROR(target.LocateGeodetic(geodetic));
  return SceneMap(std::move(system), std::move(target), scene, source.offset);
}

StatusOr<SceneMap> SceneMap::Choose(const SourceCoordinates& source, FrameChoice choice, const HeightOptions& heights,
                                    const Eigen::Vector3d& near) {
  TESSERA_ASSIGN_OR_RETURN(ReferenceSystem system, OpenSource(source, heights, near));
  const std::optional<Crs> grid = system.GridCrs();
  const bool is_grid = system.kind() == Kind::kProjected;
  if (choice == FrameChoice::kGrid && is_grid && !grid) {
    return absl::InvalidArgumentError(
        absl::StrCat("crs: found ", system.name(),
                     ", which has no EPSG code, expected a code with --crs EPSG:H or EPSG:H+V, or "
                     "--frame true"));
  }
  if (grid && (choice == FrameChoice::kGrid || !is_grid)) {
    return SceneMap(std::move(system), std::nullopt, *grid, source.offset);
  }
  Eigen::Vector3d geodetic = near + source.offset;
  TESSERA_RETURN_IF_ERROR(system.ToGeodetic({&geodetic, 1}));
  const Crs scene = EnuAt(geodetic);
  TESSERA_ASSIGN_OR_RETURN(ReferenceSystem target, ReferenceSystem::Of(scene));
  return SceneMap(std::move(system), std::move(target), scene, source.offset);
}

Status SceneMap::SceneFromSource(std::span<Eigen::Vector3d> points) const {
  if (!target_) {
    for (Eigen::Vector3d& p : points) p = (p + offset_).cwiseProduct(source_.units_m());
    return absl::OkStatus();
  }
  for (Eigen::Vector3d& p : points) p += offset_;
  TESSERA_RETURN_IF_ERROR(source_.ToGeodetic(points));
  TESSERA_RETURN_IF_ERROR(target_->FromGeodetic(points));
  for (Eigen::Vector3d& p : points) p = p.cwiseProduct(target_->units_m());
  return absl::OkStatus();
}

Status SceneMap::SourceFromScene(std::span<Eigen::Vector3d> points) const {
  if (!target_) {
    for (Eigen::Vector3d& p : points) p = p.cwiseQuotient(source_.units_m()) - offset_;
    return absl::OkStatus();
  }
  for (Eigen::Vector3d& p : points) p = p.cwiseQuotient(target_->units_m());
  TESSERA_RETURN_IF_ERROR(target_->ToGeodetic(points));
  TESSERA_RETURN_IF_ERROR(source_.FromGeodetic(points));
  for (Eigen::Vector3d& p : points) p -= offset_;
  return absl::OkStatus();
}

StatusOr<Eigen::Matrix3d> SceneMap::SceneFromSourceRotation(const Eigen::Vector3d& point) const {
  if (!target_) return Eigen::Matrix3d(Eigen::Matrix3d::Identity());
  TESSERA_ASSIGN_OR_RETURN(
      const Eigen::Matrix3d directions,
      DirectionsAt(point, JacobianStep(source_), [&](std::span<Eigen::Vector3d> p) { return SceneFromSource(p); }));
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(directions, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return Eigen::Matrix3d(svd.matrixU() * svd.matrixV().transpose());
}

StatusOr<PlacedBlock> PlaceBlock(const ImportedBlock& block, FrameChoice choice, const FrameOptions& options,
                                 Warnings* warnings) {
  const SourceCoordinates source = {options.crs.empty() ? block.crs : options.crs, block.offset};
  TESSERA_ASSIGN_OR_RETURN(SceneMap map, SceneMap::Choose(source, choice, options.heights, CentreOf(block)));
  PlacedBlock out = {block, std::move(map), false};
  out.true_frame = out.map.scene().kind == Crs::Kind::kEnu;
  ImportedBlock& placed = out.block;
  placed.crs.clear();
  placed.offset.setZero();
  std::vector<Eigen::Vector3d> centres;
  for (BlockImage& image : placed.images) {
    if (!image.oriented) continue;
    TESSERA_ASSIGN_OR_RETURN(const Eigen::Matrix3d scene_from_source, out.map.SceneFromSourceRotation(image.centre));
    image.rotation_cam_from_block *= scene_from_source.transpose();
    centres.push_back(image.centre);
  }
  TESSERA_RETURN_IF_ERROR(out.map.SceneFromSource(centres));
  size_t next = 0;
  for (BlockImage& image : placed.images) {
    if (image.oriented) image.centre = centres[next++];
  }
  for (std::vector<BlockTiePoint>* const points : {&placed.points, &placed.control_points}) {
    std::vector<Eigen::Vector3d> positions;
    for (const BlockTiePoint& point : *points) {
      if (HasPosition(point)) positions.push_back(point.position);
    }
    TESSERA_RETURN_IF_ERROR(out.map.SceneFromSource(positions));
    size_t next_position = 0;
    for (BlockTiePoint& point : *points) {
      if (HasPosition(point)) point.position = positions[next_position++];
    }
  }

  const ReferenceSystem& system = out.map.source();
  if (!options.crs.empty() && !block.crs.empty() && options.crs != block.crs) {
    warnings->push_back(absl::StrCat("the source's coordinate system is ", block.crs.substr(0, 80), "; ", options.crs,
                                     " is used instead, as --crs says"));
  }
  warnings->insert(warnings->end(), system.warnings().begin(), system.warnings().end());
  placed.conventions.insert(placed.conventions.end(), system.conventions().begin(), system.conventions().end());
  const Crs& scene = out.map.scene();
  if (out.map.keeps_coordinates()) {
    placed.conventions.push_back(system.kind() == Kind::kProjected ? absl::StrCat("coordinates of ", system.name(),
                                                                                  " are kept, as if the map "
                                                                                  "projection were Cartesian")
                                                                   : std::string("coordinates are kept"));
  } else {
    placed.conventions.push_back(absl::StrFormat(
        "positions are taken to metres east, north and up of latitude %.6f, longitude %.6f, height 0 (WGS 84); each "
        "pose is turned by the rotation of this map at its centre",
        scene.lat_rad * kDegreesPerRadian, scene.lon_rad * kDegreesPerRadian));
  }
  return out;
}

}  // namespace tessera
