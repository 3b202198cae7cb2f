// Exact nearest-point queries on a triangle mesh (Embree point queries).
#pragma once

#include <Eigen/Core>
#include <memory>

#include "common/geometry/mesh.h"

namespace tessera {

struct NearestPoint {
  int64_t face = -1;                                // index in the mesh; -1: the mesh has no faces
  Eigen::Vector3d point = Eigen::Vector3d::Zero();  // nearest point on that face, frame of the mesh
  double distance_m = 0;
};

// The point of triangle (a, b, c) nearest to `p` (Ericson, Real-Time Collision Detection, section 5.1.5). Degenerate
// triangles are treated as segments or points.
Eigen::Vector3d NearestPointOfTriangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                       const Eigen::Vector3d& c);

// Nearest-point queries on `mesh`, which must outlive this object. The search tree uses floats relative to the mesh's
// centre, with a margin for their rounding; distances are computed in double precision. Of equally near faces the one
// with the lowest index is returned, so results do not depend on threads or on the tree. Const member functions are
// thread-safe.
class NearestSurface {
 public:
  explicit NearestSurface(const TriangleMesh& mesh);
  ~NearestSurface();
  NearestSurface(NearestSurface&&) noexcept;
  NearestSurface& operator=(NearestSurface&&) noexcept;

  // `p`: metres, frame of the mesh.
  NearestPoint Find(const Eigen::Vector3d& p) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
