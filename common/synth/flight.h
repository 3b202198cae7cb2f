// The flights over the city: nadir and four oblique views a station, 80 % overlap along and 60 % across.
#ifndef TESSERA_COMMON_SYNTH_FLIGHT_H_
#define TESSERA_COMMON_SYNTH_FLIGHT_H_

#include <string>
#include <vector>

#include "common/imaging/camera.h"
#include "common/synth/plan.h"

namespace tessera {

inline constexpr double kForwardOverlap = 0.8;
inline constexpr double kSideOverlap = 0.6;
inline constexpr int kLookCount = 5;  // nadir, north, east, south, west

struct SynthView {
  std::string stem;        // file name without extension
  int look = 0;            // 0 nadir, then the directions looked to: north, east, south, west
  Eigen::Vector2d target;  // where the axis meets the ground, nearly
  PosedCamera camera;
};

// Stations on a grid over the blocks; the short side of nadir images lies along the flight lines (north).
// `width_px`, `height_px`: of every image. Nadir GSD is plan.gsd_m at the ground's mean height.
std::vector<SynthView> PlanFlight(const CityPlan& plan, int width_px, int height_px);

// The same over an area alone. `seed`: of the aircraft's drift; `prefix`: what all stems begin with.
std::vector<SynthView> PlanFlightOver(const CityPlan& plan, const Eigen::AlignedBox2d& area, uint64_t seed,
                                      const std::string& prefix, int width_px, int height_px);

}  // namespace tessera

#endif  // TESSERA_COMMON_SYNTH_FLIGHT_H_
