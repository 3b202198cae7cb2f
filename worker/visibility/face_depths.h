// Depths of pixels whose faces are known.
#ifndef TESSERA_WORKER_VISIBILITY_FACE_DEPTHS_H_
#define TESSERA_WORKER_VISIBILITY_FACE_DEPTHS_H_

#include <cstdint>

#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "worker/visibility/raster_kernel.h"

namespace tessera {

// A mesh before a camera, which both must outlive it: `vertices` as ProjectToGrid made them.
class FaceDepths {
 public:
  FaceDepths(const TriangleMesh& mesh, const GridVertex* vertices, const PosedCamera& camera)
      : mesh_(mesh), vertices_(vertices), camera_(camera) {}

  // Sets the depth of rows [row_first, row_last) of a map that is `width` wide, wherever it names a face.
  void UpdateRows(int row_first, int row_last, int width, const int32_t* face, float* depth) const;

 private:
  float UnboundedDepth(uint32_t f, int x, int y, float old) const;

  const TriangleMesh& mesh_;
  const GridVertex* vertices_;
  const PosedCamera& camera_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_VISIBILITY_FACE_DEPTHS_H_
