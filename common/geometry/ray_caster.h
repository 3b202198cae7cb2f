// Rays against a triangle mesh (Embree). Sparse queries: occlusion, camera subsets, evaluation, previews.
#ifndef TESSERA_COMMON_GEOMETRY_RAY_CASTER_H_
#define TESSERA_COMMON_GEOMETRY_RAY_CASTER_H_

#include <Eigen/Core>
#include <memory>

#include "common/geometry/mesh.h"

namespace tessera {

struct RayHit {
  int64_t face = -1;    // index in the mesh; -1: nothing was hit
  double distance = 0;  // in lengths of the ray's direction vector
  double u = 0, v = 0;  // barycentric weights of the face's second and third corner
  bool hit() const { return face >= 0; }
};

// Keeps float copies of the vertices relative to the mesh's own centre, so that meshes far from the origin lose
// nothing; the mesh itself need not outlive it. Const member functions may be called from any thread at once.
class RayCaster {
 public:
  explicit RayCaster(const MeshSpans& mesh);
  ~RayCaster();
  RayCaster(RayCaster&&) noexcept;
  RayCaster& operator=(RayCaster&&) noexcept;

  // First face along origin + s·direction with s in (near, far). Metres, the mesh's frame. Both sides of faces count.
  RayHit Cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double near = 0,
              double far = 1e30) const;

  // Whether anything lies on the segment from `from` to `to`, its ends shortened by `margin_m` each.
  bool Occluded(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double margin_m) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera

#endif  // TESSERA_COMMON_GEOMETRY_RAY_CASTER_H_
