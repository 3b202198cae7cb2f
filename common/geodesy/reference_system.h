// Coordinate reference systems by name or definition, and their conversion to WGS 84. Uses PROJ and GeographicLib.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/geodesy/frame.h"

namespace tessera {

// How heights are understood. Default: as the system says; where it names no vertical datum, above the WGS 84
// ellipsoid.
struct HeightOptions {
  bool ellipsoid = false;  // above the WGS 84 ellipsoid, whatever vertical datum the system names
  // Height of the vertical datum above the WGS 84 ellipsoid, metres: used instead of PROJ's conversion.
  std::optional<double> geoid_height_m = {};
  bool operator==(const HeightOptions&) const = default;
};

// A coordinate reference system of a source. Coordinates are in its units, in the order (easting or longitude, northing
// or latitude, height) whatever the order of its axes is; geocentric ones are (x, y, z). Longitude and latitude are in
// the system's unit, mostly degrees. Where the system names no vertical datum, heights have the unit of the plan
// (metres if that is an angle).
//
// PROJ's network is off and its ballpark operations are forbidden: a transformation that PROJ would guess, or whose
// grid is not installed, is an error that names the grid. Plan and height are converted apart: the plan by a horizontal
// operation, the height by a geoid model. A vertical datum that cannot be converted is kept: its heights count as
// heights above the ellipsoid, with a warning. Conversions back use the same operations, so a round trip is exact
// (1e-6 m) whatever was assumed.
//
// Each object has its own PROJ context. Safe to call concurrently; calls on one object wait for each other.
class ReferenceSystem {
 public:
  enum class Kind { kLocal, kEnu, kGeographic, kProjected, kGeocentric };

  // `text`: what PROJ reads (EPSG:H, EPSG:H+V, WKT of version 1, 2 or ESRI, a PROJ string, a name such as WGS84),
  // ENU:LAT,LON[,H] (degrees, metres, WGS 84), `local` or nothing. INVALID_ARGUMENT with PROJ's reason.
  static StatusOr<ReferenceSystem> Parse(const std::string& text, const HeightOptions& heights = {});
  // The system of scenes with this Crs. Its coordinates are those of the scene divided by units_m().
  static StatusOr<ReferenceSystem> Of(const Crs& crs);
  ReferenceSystem(ReferenceSystem&&) noexcept;
  ReferenceSystem& operator=(ReferenceSystem&&) noexcept;
  ~ReferenceSystem();

  // Chooses the most accurate operations to WGS 84 whose area of use has the point `near` (coordinates of the system).
  // To be called once before a conversion. INVALID_ARGUMENT if there is no operation without a missing grid, or if the
  // point is outside the domain of the system.
  Status Locate(const Eigen::Vector3d& near);
  // The same around WGS 84 latitude and longitude (radians) and height (metres).
  Status LocateGeodetic(const Eigen::Vector3d& near);

  Kind kind() const;
  // For messages, such as "RGF93 v1 / Lambert-93 (EPSG:2154)".
  const std::string& name() const;
  // Metres per unit of each coordinate; 1 for angles. (1, 1, 1) unless a projected or vertical system has other units.
  const Eigen::Vector3d& units_m() const;
  // The Crs of scenes whose coordinates are those of the system, times units_m(). None for angles, geocentric
  // coordinates, and projected or vertical systems without EPSG code.
  std::optional<Crs> GridCrs() const;
  // Of the horizontal operation, as PROJ states it. 0 for a mere projection of WGS 84; -1: not known.
  double accuracy_m() const;
  // What a user must know, a sentence each: a poor accuracy, missing grids, heights that were kept, other units than
  // metres, a place outside the area of use. Complete after Locate().
  const Warnings& warnings() const;
  // What was applied, a sentence each.
  const std::vector<std::string>& conventions() const;

  // In place: coordinates of the system to and from WGS 84 latitude and longitude (radians) and height (metres) above
  // the ellipsoid (EPSG:4979). FAILED_PRECONDITION for kLocal. INVALID_ARGUMENT names a point that has no image.
  Status ToGeodetic(std::span<Eigen::Vector3d> points) const;
  Status FromGeodetic(std::span<Eigen::Vector3d> points) const;

 private:
  struct Impl;
  explicit ReferenceSystem(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// WGS 84: earth-centred metres from latitude and longitude (radians) and height (metres), and back.
Eigen::Vector3d GeocentricFromGeodetic(const Eigen::Vector3d& geodetic);
Eigen::Vector3d GeodeticFromGeocentric(const Eigen::Vector3d& geocentric);

}  // namespace tessera
