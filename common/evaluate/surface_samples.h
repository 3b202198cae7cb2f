// Points drawn on a surface, and which of them the cameras see.
#ifndef TESSERA_COMMON_EVALUATE_SURFACE_SAMPLES_H_
#define TESSERA_COMMON_EVALUATE_SURFACE_SAMPLES_H_

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/geometry/ray_caster.h"
#include "common/scene/scene.h"

namespace tessera {

struct SurfaceSample {
  Eigen::Vector3d point;  // the mesh's frame, metres
  uint32_t face = 0;
};

// `count` points on `mesh`, uniform by area: one in each of `count` equal parts of the area in the order of faces, so
// the draw is even. The same points for the same mesh and seed. Empty if the mesh has no area.
std::vector<SurfaceSample> SampleByArea(const TriangleMesh& mesh, int64_t count, uint64_t seed);

// Those of `samples` (on `mesh`, of which `caster` was made) that at least `min_views` of `views` see: the point
// projects into the undistorted image and nothing of the mesh lies between it and the camera. The ray ends short of
// the point by a five-thousandth of its length (a fifth of a pixel's footprint at a focal length of 1,000 pixels).
// Which way the face looks does not matter by itself: the back of a closed surface is hidden by its front, and an open
// surface counts on both sides (asking for the front alone moves no figure of real scenes by more than 1 %). In the
// order of `samples`. Local frame.
std::vector<SurfaceSample> SeenSamples(const std::vector<SurfaceSample>& samples, const RayCaster& caster,
                                       const std::vector<SceneView>& views, int min_views);

}  // namespace tessera

#endif  // TESSERA_COMMON_EVALUATE_SURFACE_SAMPLES_H_
