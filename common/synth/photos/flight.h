// Flight plans: one nadir and four oblique views per station, forward overlap 80 %, side overlap 60 %.
#pragma once

#include <string>
#include <vector>

#include "common/imaging/camera.h"
#include "common/synth/city/plan.h"

namespace tessera {

inline constexpr double kForwardOverlap = 0.8;
inline constexpr double kSideOverlap = 0.6;
inline constexpr int kDirections = 5;  // nadir, north, east, south, west

struct SynthView {
  std::string stem;        // file name without extension
  int direction = 0;       // viewing direction: 0 nadir, then north, east, south, west
  Eigen::Vector2d target;  // approximate intersection of the optical axis with the ground
  PosedCamera camera;
};

// Stations on a grid over the blocks; the short side of nadir images is parallel to the flight lines (north).
// `width_px`, `height_px`: size of all images. The nadir GSD is plan.gsd_m at the mean height of the ground.
std::vector<SynthView> PlanFlight(const CityPlan& plan, int width_px, int height_px);

// The same for an area. `seed`: for the aircraft's drift; `prefix`: prefix of all stems.
std::vector<SynthView> PlanFlightOver(const CityPlan& plan, const Eigen::AlignedBox2d& area, uint64_t seed,
                                      const std::string& prefix, int width_px, int height_px);

}  // namespace tessera
