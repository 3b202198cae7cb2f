// Conventions of other programs: what a block would be if its reader had taken one for another.
#pragma once

#include <vector>

#include "common/blocks/block.h"

namespace tessera {

// Poses: rotations transposed, centres that are translations, or the reverse, other axes of cameras, rotations, centres
// or points; also several of the first three together. The simpler ones come first.
std::vector<BlockReading> PoseAlternatives();

// Lenses and image points: half a pixel, origin and direction of image coordinates, the order and signs of
// coefficients, the unit of focal lengths.
std::vector<BlockReading> LensAlternatives();

}  // namespace tessera
