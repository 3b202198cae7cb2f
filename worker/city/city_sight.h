// Whether anything of a city hides a point from a camera.
#ifndef TESSERA_WORKER_CITY_CITY_SIGHT_H_
#define TESSERA_WORKER_CITY_CITY_SIGHT_H_

#include <Eigen/Geometry>
#include <memory>

#include "common/base/status.h"
#include "common/geometry/coarse_mesh.h"
#include "common/geometry/ray_caster.h"
#include "worker/city/city_file.h"

namespace tessera {

// Near a point the city is tested in full, farther away by its coarse shape; either may be left out. The Set functions
// copy what they are given. Hidden may be called from any thread at once.
class CitySight {
 public:
  // `margin_m`: nothing nearer than that hides a point.
  explicit CitySight(double margin_m) : margin_m_(margin_m) {}
  void SetNear(const MeshSpans& faces) { near_ = std::make_unique<RayCaster>(faces); }
  void SetFar(const CoarseMesh& coarse) {
    far_ = std::make_unique<RayCaster>(coarse.mesh);
    far_margin_m_ = margin_m_ + 2 * coarse.error_m;
  }
  // How far around a point the full city is asked for, since its coarse shape is not told from the point's own surface.
  double near_m() const { return far_margin_m_; }

  bool Hidden(const Eigen::Vector3d& point, const Eigen::Vector3d& camera) const {
    return (far_ && far_->Occluded(point, camera, far_margin_m_)) ||
           (near_ && near_->Occluded(point, camera, margin_m_));
  }

 private:
  double margin_m_, far_margin_m_ = 0;
  std::unique_ptr<RayCaster> near_, far_;
};

// The faces of the city that may reach to within `reach_m` of the box, without labels. Errors as CityReader::Block's.
StatusOr<TriangleMesh> FacesAround(const CityReader& city, const Eigen::AlignedBox3d& box, double reach_m);

}  // namespace tessera

#endif  // TESSERA_WORKER_CITY_CITY_SIGHT_H_
