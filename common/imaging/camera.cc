#include "common/imaging/camera.h"

namespace tessera {

// FULL_OPENCV of COLMAP (src/colmap/sensor/models.h). It covers all models of COLMAP, because missing coefficients are
// zero.
Eigen::Vector2d LensModel::Distort(const Eigen::Vector2d& p) const {
  if (kind == Kind::kPinhole) return p;
  const auto& [k1, k2, p1, p2, k3, k4, k5, k6] = coefficients;
  const double u = (p.x() - pinhole.cx) / pinhole.fx, v = (p.y() - pinhole.cy) / pinhole.fy;
  const double r2 = u * u + v * v;
  const bool is_brown = kind == Kind::kBrown;
  const double radial = is_brown ? 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
                                 : (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)));
  const double du = u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u * u);
  const double dv = v * radial + 2 * p2 * u * v + p1 * (r2 + 2 * v * v);
  const double skew = is_brown ? coefficients[6] : 0;
  return {pinhole.fx * du + skew * dv + pinhole.cx, pinhole.fy * dv + pinhole.cy};
}

Eigen::Vector2d LensModel::Undistort(const Eigen::Vector2d& p) const {
  if (kind == Kind::kPinhole) return p;
  Eigen::Vector2d undistorted = p;
  for (int i = 0; i < 20; ++i) {
    const Eigen::Vector2d error = Distort(undistorted) - p;
    undistorted -= error;
    if (!(error.squaredNorm() > 1e-6)) break;
  }
  return undistorted.allFinite() ? undistorted : p;
}

}  // namespace tessera
