// Ray casting on a triangle mesh (Embree), for sparse queries: occlusion, coverage, evaluation, previews.
#pragma once

#include <Eigen/Core>
#include <memory>

#include "common/geometry/mesh.h"

namespace tessera {

struct RayHit {
  int64_t face = -1;    // index in the mesh; -1: nothing was hit
  double distance = 0;  // in units of the length of the direction vector
  double u = 0, v = 0;  // barycentric coordinates: weights of the second and third corner
  bool hit() const { return face >= 0; }
};

// How the tree of faces is built. kQuick builds trees of parts of the mesh on all threads, in a quarter of the time on
// one (.1 us a face instead of .45), and rays take up to three times as long (1 us more): for meshes with many more
// faces than rays. Hits are the same, but for faces that tie.
enum class RayTree { kThorough, kQuick };

// Copies the mesh; vertices are stored as floats relative to the mesh's centre, so that meshes far from the origin keep
// their precision. Const member functions are thread-safe.
class RayCaster {
 public:
  explicit RayCaster(const MeshSpans& mesh, RayTree tree = RayTree::kThorough);
  ~RayCaster();
  RayCaster(RayCaster&&) noexcept;
  RayCaster& operator=(RayCaster&&) noexcept;

  // The first face hit by origin + s·direction with s in (near, far). Metres, frame of the mesh. Faces are hit from
  // both sides.
  RayHit Cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double near = 0,
              double far = 1e30) const;

  // Whether a face intersects the segment from `from` to `to`, shortened by `margin_m` at both ends.
  bool Occluded(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double margin_m) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
