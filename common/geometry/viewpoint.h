// A camera without its pixels, for visibility tests.
#pragma once

#include <Eigen/Core>

namespace tessera {

struct Viewpoint {
  Eigen::Vector3d centre;                  // frame of the mesh, metres
  Eigen::Matrix<double, 3, 4> projection;  // to homogeneous pixel coordinates; the third is the depth in metres
  double width_px = 0, height_px = 0;
  double focal_product_px2 = 0;  // fx · fy

  Eigen::Vector3d Homogeneous(const Eigen::Vector3d& p) const { return projection * p.homogeneous(); }
  bool InImage(const Eigen::Vector3d& homogeneous) const {
    return homogeneous.z() > 0 && homogeneous.x() >= 0 && homogeneous.y() >= 0 &&
           homogeneous.x() < width_px * homogeneous.z() && homogeneous.y() < height_px * homogeneous.z();
  }
};

}  // namespace tessera
