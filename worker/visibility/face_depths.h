// Depths of pixels whose faces are known.
#ifndef TESSERA_WORKER_VISIBILITY_FACE_DEPTHS_H_
#define TESSERA_WORKER_VISIBILITY_FACE_DEPTHS_H_

#include <cstdint>

#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "worker/visibility/raster_kernel.h"

namespace tessera {

// Sets the depth of rows [row_first, row_last) of a map that is `width` wide, wherever `face` names a face: that of the
// face's plane, within the range of its corners. `vertices` as ProjectToGrid made them of the mesh. For a face with all
// corners on the grid it is what drawing it gives, to the bit; of one that has no area any more the old depth is kept,
// within the new range.
void UpdateFaceDepths(const TriangleMesh& mesh, const GridVertex* vertices, const PosedCamera& camera, int row_first,
                      int row_last, int width, const int32_t* face, float* depth);

}  // namespace tessera

#endif  // TESSERA_WORKER_VISIBILITY_FACE_DEPTHS_H_
