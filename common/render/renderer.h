// Rendered images of meshes for people: ray casting (Embree), daylight and ambient occlusion.
#pragma once

#include <Eigen/Core>
#include <functional>

#include "common/geometry/mesh.h"
#include "common/geometry/ray_caster.h"
#include "common/imaging/camera.h"
#include "common/imaging/raster.h"

namespace tessera {

// Red, green, blue in [0, 1].
using Color = Eigen::Vector3f;

// Colour of a surface point without shading. Called concurrently from several threads.
using SurfaceColor = std::function<Color(size_t face, const Eigen::Vector3d& point)>;

struct RenderOptions {
  int samples_per_axis = 2;                       // rays per pixel: samples_per_axis squared
  int occlusion_rays = 16;                        // per ray; 0: no ambient occlusion
  bool lit = true;                                // false: colours without shading
  bool edges = false;                             // draw face edges dark
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();  // unit vector, frame of the mesh
};

// RGB image of `mesh` from `camera`, both in one metric frame; `caster` was made from `mesh`. Light comes from the sky,
// from a sun behind and to the left of the camera, and from the camera. Ambient occlusion has a range of 1/20 of the
// mesh's diagonal. Faces are flat-shaded on the visible side. The result does not depend on the number of threads.
ByteImage Render(const TriangleMesh& mesh, const RayCaster& caster, const PosedCamera& camera,
                 const SurfaceColor& color, const RenderOptions& options);

}  // namespace tessera
