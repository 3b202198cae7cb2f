// What a labelled mesh looks like in a view: one ray a pixel.
#ifndef TESSERA_COMMON_EVALUATE_LABEL_RENDERING_H_
#define TESSERA_COMMON_EVALUATE_LABEL_RENDERING_H_

#include "common/geometry/mesh.h"
#include "common/geometry/ray_caster.h"
#include "common/imaging/camera.h"
#include "common/imaging/raster.h"

namespace tessera {

// Class of the first face met through each pixel's centre; 255 where nothing is met or the face has no label.
// `caster` was made of `mesh`; `camera` in the mesh's frame. Labels below 255.
LabelImage RenderLabels(const TriangleMesh& mesh, const RayCaster& caster, const PosedCamera& camera);

// Label image in the photograph's own frame, as stored with the scene, brought to `lens.pinhole` by the nearest pixel;
// its resolution may differ from the photograph's. 255 outside.
LabelImage UndistortLabels(const LabelImage& labels, const LensModel& lens);

}  // namespace tessera

#endif  // TESSERA_COMMON_EVALUATE_LABEL_RENDERING_H_
