// Draws the few faces that the kernel's fixed-point grid cannot represent: those that cross the near plane, reach far
// beyond the image border, or span thousands of pixels. Uses double precision; speed does not matter here.
#pragma once

#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "worker/visibility/raster_kernel.h"

namespace tessera {

// Draws face `f`. Edges with both ends on the grid are tested exactly as in the kernel, bit for bit.
// Both faces of an edge with an end off the grid are drawn here, so they agree as well.
void DrawUnboundedFace(const TriangleMesh& mesh, uint32_t f, const GridVertex* vertices, const PosedCamera& camera,
                       double near_m, const DrawTarget& target);

}  // namespace tessera
