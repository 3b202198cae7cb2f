// Pictures of meshes for people's eyes: rays (Embree), daylight and the shade of narrow places.
#ifndef TESSERA_COMMON_RENDER_RENDERER_H_
#define TESSERA_COMMON_RENDER_RENDERER_H_

#include <Eigen/Core>
#include <functional>

#include "common/geometry/mesh.h"
#include "common/geometry/ray_caster.h"
#include "common/imaging/camera.h"
#include "common/imaging/raster.h"

namespace tessera {

// Red, green, blue in [0, 1].
using Color = Eigen::Vector3f;

// Colour of a surface point before light falls on it. Called from many threads at once.
using SurfaceColor = std::function<Color(size_t face, const Eigen::Vector3d& point)>;

struct RenderOptions {
  int samples_per_axis = 2;  // rays a pixel are the square of it
  int occlusion_rays = 16;   // for each of them; 0: no ambient shade
  bool lit = true;           // false: the surface's colour as it is
  bool edges = false;        // faces' edges drawn dark
  Color background = Color(1, 1, 1);
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();  // unit, the mesh's frame
};

// RGB picture of `mesh` (of which `caster` was made) from `camera`, in one frame, metres. Daylight comes from above,
// from behind the camera's left shoulder and a little from the camera itself; ambient shade reaches a twentieth of the
// mesh's diagonal. Faces are flat and lit from whichever side is seen. The same bytes for any number of threads.
ByteImage Render(const TriangleMesh& mesh, const RayCaster& caster, const PosedCamera& camera,
                 const SurfaceColor& color, const RenderOptions& options);

}  // namespace tessera

#endif  // TESSERA_COMMON_RENDER_RENDERER_H_
