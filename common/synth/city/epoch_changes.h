// Changes of a second epoch of the city: buildings and trees added or removed, ground and roofs turned into vegetation.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/change_kind.h"
#include "common/synth/city/plan.h"

namespace tessera {

struct CityChange {
  ChangeKind kind = ChangeKind::kBuilt;
  std::vector<Eigen::Vector2d> footprint;  // counter-clockwise from above, not closed, rounded to millimetres
  double area_m2 = 0;                      // of the footprint
  double height_difference_m = 0;          // mean of new minus old surface height over the footprint
};

struct ChangedCity {
  CityPlan plan;  // including the changes
  std::vector<CityChange> changes;
};

inline constexpr double kMinChangeArea_m2 = 30;
inline constexpr double kMinFelledArea_m2 = 10;  // used if there are no larger trees

// The minimum distance in metres of all footprints from the border of `part`.
double ChangeInset(const Eigen::AlignedBox2d& part);

// Changes objects inside `part` (city frame). Makes about one change of each kind per 2500 square metres, at most 12 of
// a kind, as space permits; every third change of kind kBuilt raises an existing building. Footprints keep 3 m from
// each other and cover kMinChangeArea_m2 at least (a felled tree kMinFelledArea_m2). What is not changed stays the same
// to the last bit. The same for the same `plan`, `part` and `seed`.
ChangedCity ChangeCity(const CityPlan& plan, const Eigen::AlignedBox2d& part, uint64_t seed);

// GeoJSON: a polygon for each change with its kind, area_m2 and height_difference_m, in the city's plan coordinates.
Status WriteChanges(const std::string& path, const std::vector<CityChange>& changes);

}  // namespace tessera
