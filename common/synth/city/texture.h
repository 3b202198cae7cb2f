// Procedural textures: the albedo as a function of the position in the city.
#pragma once

#include <Eigen/Core>

#include "common/synth/city/plan.h"
#include "common/synth/city/surface.h"

namespace tessera {

// Linear RGB albedo in [0, 1] of `patch` at `p` (world frame). Wavelengths range from about half the plan's GSD to
// metres.
Eigen::Vector3f Albedo(const CityPlan& plan, const SurfacePatch& patch, const Eigen::Vector3d& p);

}  // namespace tessera
