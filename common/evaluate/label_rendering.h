// Label images rendered from a labelled mesh, one ray per pixel.
#pragma once

#include "common/geometry/mesh.h"
#include "common/geometry/ray_caster.h"
#include "common/imaging/camera.h"
#include "common/imaging/raster.h"

namespace tessera {

// The class of the first face hit by the ray through each pixel centre; 255 if no face is hit or the face has no label.
// `caster` was made from `mesh`; `camera` is in the mesh's frame. Labels are below 255.
LabelImage RenderLabels(const TriangleMesh& mesh, const RayCaster& caster, const PosedCamera& camera);

// Resamples a label image of the distorted photograph onto `lens.pinhole` (nearest pixel); 255 outside. Its resolution
// may differ from the photograph's.
LabelImage UndistortLabels(const LabelImage& labels, const LensModel& lens);

}  // namespace tessera
