// Procedural textures: the albedo as a function of the position in the city.
#ifndef TESSERA_COMMON_SYNTH_TEXTURE_H_
#define TESSERA_COMMON_SYNTH_TEXTURE_H_

#include <Eigen/Core>

#include "common/synth/plan.h"
#include "common/synth/surface.h"

namespace tessera {

// Linear RGB albedo in [0, 1] of `patch` at `p` (world frame). Wavelengths range from about half the plan's GSD to
// metres.
Eigen::Vector3f Albedo(const CityPlan& plan, const SurfacePatch& patch, const Eigen::Vector3d& p);

}  // namespace tessera

#endif  // TESSERA_COMMON_SYNTH_TEXTURE_H_
