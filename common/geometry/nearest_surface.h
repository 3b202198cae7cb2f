// The nearest point of a triangle mesh, exactly (Embree's point query).
#ifndef TESSERA_COMMON_GEOMETRY_NEAREST_SURFACE_H_
#define TESSERA_COMMON_GEOMETRY_NEAREST_SURFACE_H_

#include <Eigen/Core>
#include <memory>

#include "common/geometry/mesh.h"

namespace tessera {

struct NearestPoint {
  int64_t face = -1;                                // index in the mesh; -1: the mesh has no face
  Eigen::Vector3d point = Eigen::Vector3d::Zero();  // on that face, the mesh's frame
  double distance_m = 0;
};

// The point of triangle (a, b, c) nearest to `p` (Ericson, Real-Time Collision Detection, section 5.1.5). Triangles
// without area are segments or points.
Eigen::Vector3d NearestPointOfTriangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                       const Eigen::Vector3d& c);

// The search tree holds floats relative to the mesh's centre and only discards what is farther off than its rounding;
// distances are computed in double precision from `mesh`, which must outlive this. Of faces equally near the one with
// the lowest index is given, so results depend neither on threads nor on the tree. Const member functions may be
// called from any thread at once.
class NearestSurface {
 public:
  explicit NearestSurface(const TriangleMesh& mesh);
  ~NearestSurface();
  NearestSurface(NearestSurface&&) noexcept;
  NearestSurface& operator=(NearestSurface&&) noexcept;

  // `p` in metres, the mesh's frame.
  NearestPoint Find(const Eigen::Vector3d& p) const;

  // Whether the nearest point is at most `distance_m` from `p`; cheaper than finding it.
  bool IsWithin(const Eigen::Vector3d& p, double distance_m) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera

#endif  // TESSERA_COMMON_GEOMETRY_NEAREST_SURFACE_H_
