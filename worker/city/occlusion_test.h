// Tests whether the city's surface occludes a point from a camera.
#pragma once

#include <Eigen/Geometry>
#include <memory>

#include "common/base/status.h"
#include "common/geometry/coarse_mesh.h"
#include "common/geometry/ray_caster.h"
#include "worker/city/city_file.h"

namespace tessera {

// Casts rays against the full mesh near a point and against a simplified mesh farther away. Either may be missing.
// The Set functions copy their arguments. Hidden is thread-safe.
class OcclusionTest {
 public:
  // `margin_m`: surfaces closer to a point than this do not occlude it.
  explicit OcclusionTest(double margin_m) : margin_m_(margin_m) {}
  void SetNear(const MeshSpans& faces) { near_ = std::make_unique<RayCaster>(faces); }
  void SetFar(const CoarseMesh& coarse) {
    far_ = std::make_unique<RayCaster>(coarse.mesh);
    far_margin_m_ = margin_m_ + 2 * coarse.error_m;
  }
  // Radius around a point within which the full mesh is needed, since the simplified mesh cannot be distinguished
  // from the point's own surface.
  double near_m() const { return far_margin_m_; }

  bool Hidden(const Eigen::Vector3d& point, const Eigen::Vector3d& camera) const {
    return (far_ && far_->Occluded(point, camera, far_margin_m_)) ||
           (near_ && near_->Occluded(point, camera, margin_m_));
  }

 private:
  double margin_m_, far_margin_m_ = 0;
  std::unique_ptr<RayCaster> near_, far_;
};

// Faces of the city whose blocks lie within `radius_m` of the box, without labels. Errors as CityReader::Block.
StatusOr<TriangleMesh> FacesAround(const CityReader& city, const Eigen::AlignedBox3d& box, double radius_m);

}  // namespace tessera
