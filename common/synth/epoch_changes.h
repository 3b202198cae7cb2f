// What a later epoch of the city has otherwise: buildings and trees that came or went, ground and roofs that were
// planted.
#ifndef TESSERA_COMMON_SYNTH_EPOCH_CHANGES_H_
#define TESSERA_COMMON_SYNTH_EPOCH_CHANGES_H_

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/synth/plan.h"

namespace tessera {

// kLabel: the class alone; heights stay.
enum class ChangeKind { kBuilt, kDemolished, kGrown, kFelled, kLabel };
inline constexpr int kChangeKinds = 5;
// "built", "demolished", "grown", "felled", "label".
const char* ChangeName(ChangeKind kind);

struct CityChange {
  ChangeKind kind = ChangeKind::kBuilt;
  std::vector<Eigen::Vector2d> footprint;  // seen from above, counter-clockwise, not closed, whole millimetres
  double area_m2 = 0;                      // of the footprint
  double height_difference_m = 0;          // new surface minus old, mean over the footprint
};

struct ChangedCity {
  CityPlan plan;  // with its changes
  std::vector<CityChange> changes;
};

inline constexpr double kLeastChangeArea = 30;  // square metres
inline constexpr double kLeastFelledArea = 10;  // where no larger trees stand

// How far inside `part` all footprints stay, metres.
double ChangeInset(const Eigen::AlignedBox2d& part);

// Changes objects of the city that lie inside `part` (city's frame), all kinds in turn as far as there is room, about
// one of a kind for 2500 square metres and at most 12; one in three of those built is a building that was raised.
// Footprints keep 3 m from each other and cover kLeastChangeArea at least (a felled tree kLeastFelledArea). What is not
// changed stays the same to the last bit. The same for the same `plan`, `part` and `seed`.
ChangedCity ChangeCity(const CityPlan& plan, const Eigen::AlignedBox2d& part, uint64_t seed);

// GeoJSON: a polygon for each change with its kind, area_m2 and height_difference_m, in the city's plan coordinates.
Status WriteChanges(const std::string& path, const std::vector<CityChange>& changes);

}  // namespace tessera

#endif  // TESSERA_COMMON_SYNTH_EPOCH_CHANGES_H_
