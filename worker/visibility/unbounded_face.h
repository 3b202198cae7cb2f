// Faces that the kernel's grid cannot hold: through the near plane, far beyond the image's rim, or thousands of pixels
// large. Few, so drawn in double precision and without haste.
#ifndef TESSERA_WORKER_VISIBILITY_UNBOUNDED_FACE_H_
#define TESSERA_WORKER_VISIBILITY_UNBOUNDED_FACE_H_

#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "worker/visibility/raster_kernel.h"

namespace tessera {

// Draws face `f` with this id. An edge with both ends on the grid is decided as the kernel does, bit for bit; an edge
// with an end off the grid is the same for both of its faces, which are both drawn here.
void DrawUnboundedFace(const TriangleMesh& mesh, uint32_t f, const GridVertex* vertices, const PosedCamera& camera,
                       double near_m, int32_t id, const DrawTarget& target);

}  // namespace tessera

#endif  // TESSERA_WORKER_VISIBILITY_UNBOUNDED_FACE_H_
