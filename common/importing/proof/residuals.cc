#include "common/importing/proof/residuals.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr double kParallel_rad = 1e-4;
constexpr int kGaussNewtonSteps = 3;

// None behind the camera.
std::optional<Eigen::Vector2d> ProjectBlockPoint(const ImportedBlock& block, const BlockImage& image,
                                                 const Eigen::Vector3d& p) {
  const LensModel& lens = block.cameras[static_cast<size_t>(image.camera)].lens;
  const Eigen::Vector3d x = image.rotation_cam_from_block * (p - image.centre);
  if (!(x.z() > 0)) return std::nullopt;
  const PinholeCamera& c = lens.pinhole;
  return lens.Distort({c.fx * x.x() / x.z() + c.cx, c.fy * x.y() / x.z() + c.cy});
}

bool ObservationHasPose(const ImportedBlock& block, const BlockObservation& observation) {
  const BlockImage& image = block.images[static_cast<size_t>(observation.image)];
  return image.oriented && image.camera >= 0;
}

// One Gauss-Newton step on the residuals of the point's observations. False if the step is not finite or leads behind a
// camera.
bool ImprovePosition(const ImportedBlock& block, const BlockTiePoint& point, Eigen::Vector3d* position) {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const BlockObservation& observation : point.observations) {
    if (!ObservationHasPose(block, observation)) continue;
    const BlockImage& image = block.images[static_cast<size_t>(observation.image)];
    const std::optional<Eigen::Vector2d> projected = ProjectBlockPoint(block, image, *position);
    if (!projected) return false;
    const double step = 1e-6 * (*position - image.centre).norm();
    Eigen::Matrix<double, 2, 3> jacobian;
    for (int axis = 0; axis < 3; ++axis) {
      const std::optional<Eigen::Vector2d> moved =
          ProjectBlockPoint(block, image, *position + step * Eigen::Vector3d::Unit(axis));
      if (!moved) return false;
      jacobian.col(axis) = (*moved - *projected) / step;
    }
    matrix += jacobian.transpose() * jacobian;
    right += jacobian.transpose() * (observation.position_px - *projected);
  }
  const Eigen::Vector3d step = matrix.ldlt().solve(right);
  if (!step.allFinite()) return false;
  *position += step;
  return true;
}

}  // namespace

ResidualSummary SummariseResiduals(std::vector<float> residuals_px) {
  std::erase_if(residuals_px, [](float residual) { return std::isnan(residual); });
  ResidualSummary summary;
  summary.observations = static_cast<int64_t>(residuals_px.size());
  if (residuals_px.empty()) return summary;
  const auto quantile = [&](size_t hundredths) {
    const auto at = residuals_px.begin() + static_cast<ptrdiff_t>((residuals_px.size() - 1) * hundredths / 100);
    std::nth_element(residuals_px.begin(), at, residuals_px.end());
    return static_cast<double>(*at);
  };
  summary.median_px = quantile(50);
  summary.p95_px = quantile(95);
  return summary;
}

bool HasPosition(const BlockTiePoint& point) { return point.position.allFinite() && !point.position.isZero(0); }

std::optional<Eigen::Vector3d> TriangulatePoint(const ImportedBlock& block, const BlockTiePoint& point) {
  // The point with the least squared distances from all rays.
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero(), origin = Eigen::Vector3d::Zero();
  int rays = 0;
  for (const BlockObservation& observation : point.observations) {
    if (!ObservationHasPose(block, observation)) continue;
    const BlockImage& image = block.images[static_cast<size_t>(observation.image)];
    const LensModel& lens = block.cameras[static_cast<size_t>(image.camera)].lens;
    const Eigen::Vector2d p = lens.Undistort(observation.position_px);
    const PinholeCamera& c = lens.pinhole;
    const Eigen::Vector3d ray =
        (image.rotation_cam_from_block.transpose() * Eigen::Vector3d((p.x() - c.cx) / c.fx, (p.y() - c.cy) / c.fy, 1))
            .normalized();
    if (rays++ == 0) origin = image.centre;
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - ray * ray.transpose();
    matrix += across;
    right += across * (image.centre - origin);
  }
  if (rays < 2 || !matrix.allFinite()) return std::nullopt;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(matrix, Eigen::EigenvaluesOnly);
  if (!(solver.eigenvalues()[0] > kParallel_rad * kParallel_rad)) return std::nullopt;
  Eigen::Vector3d position = origin + matrix.ldlt().solve(right);
  for (int i = 0; i < kGaussNewtonSteps; ++i) {
    if (!ImprovePosition(block, point, &position)) return std::nullopt;
  }
  return position;
}

std::vector<float> ResidualsOf(const ImportedBlock& block, const std::vector<BlockTiePoint>& points) {
  std::vector<size_t> first(points.size() + 1, 0);
  for (size_t i = 0; i < points.size(); ++i) first[i + 1] = first[i] + points[i].observations.size();
  std::vector<float> residuals(first.back());
  ParallelForEach(points.size(), 256, [&](size_t i) {
    const BlockTiePoint& point = points[i];
    const std::optional<Eigen::Vector3d> position =
        HasPosition(point) ? std::optional(point.position) : TriangulatePoint(block, point);
    for (size_t k = 0; k < point.observations.size(); ++k) {
      const BlockObservation& observation = point.observations[k];
      float& residual = residuals[first[i] + k];
      residual = std::numeric_limits<float>::quiet_NaN();
      if (!ObservationHasPose(block, observation)) continue;
      residual = std::numeric_limits<float>::infinity();
      if (!position) continue;
      const std::optional<Eigen::Vector2d> projected =
          ProjectBlockPoint(block, block.images[static_cast<size_t>(observation.image)], *position);
      if (!projected) continue;
      const double distance = (*projected - observation.position_px).norm();
      if (std::isfinite(distance)) residual = static_cast<float>(distance);
    }
  });
  return residuals;
}

}  // namespace tessera
