#include "common/classify/mesh_surface.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr double kCellInGsd = 4;
constexpr double kMaxCells = 4e6;

cv::Mat View(const FloatImage& image) {
  return cv::Mat(image.height, image.width, CV_32F, const_cast<float*>(image.data.data()));
}

cv::Mat Disc(double radius_m, double cell_m) {
  const int radius = std::max(1, static_cast<int>(std::lround(radius_m / cell_m)));
  return cv::getStructuringElement(cv::MORPH_RECT, {2 * radius + 1, 2 * radius + 1});
}

}  // namespace

MeshSurface::MeshSurface(const TriangleMesh& mesh, const Eigen::Vector3d& up, double gsd_m) : caster_(mesh) {
  normals_.reserve(mesh.faces.size());
  for (size_t f = 0; f < mesh.faces.size(); ++f) normals_.push_back(FaceNormal(mesh, f).cast<float>());
  const Eigen::Vector3d side = up.cross(std::abs(up.x()) < 0.9 ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitY());
  axes_.row(0) = side.normalized();
  axes_.row(1) = up.cross(side).normalized();
  axes_.row(2) = up;
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& v : mesh.vertices) box.extend(Eigen::Vector3d(axes_ * v));
  low_m_ = box.min().head<2>();
  high_m_ = box.max().head<2>();
  const Eigen::Vector2d extent = (high_m_ - low_m_).cwiseMax(1e-3);
  cell_m_ = std::max({kCellInGsd * gsd_m, std::sqrt(extent.x() * extent.y() / kMaxCells), extent.maxCoeff() / 20000});
  const int width = static_cast<int>(extent.x() / cell_m_) + 1, height = static_cast<int>(extent.y() / cell_m_) + 1;

  // Height of the surface seen from above. Cells without surface get the neutral value of each operation (erosion,
  // dilation), so that neighbouring cells determine the result.
  constexpr float kNone = std::numeric_limits<float>::max();
  FloatImage top(width, height, 1, -kNone);
  const double above = box.max().z() + 1;
  ParallelForEach(height, 16, [&](int y) {
    for (int x = 0; x < width; ++x) {
      const Eigen::Vector3d from(low_m_.x() + (x + 0.5) * cell_m_, low_m_.y() + (y + 0.5) * cell_m_, above);
      const RayHit hit = caster_.Cast(axes_.transpose() * from, -up);
      if (hit.hit()) top.at(x, y) = static_cast<float>(above - hit.distance);
    }
  });
  FloatImage top_or_high = top;
  for (float& value : top_or_high.data) value = value == -kNone ? kNone : value;
  const auto filled = [&](cv::Mat values, float absent) {
    FloatImage image(width, height);
    cv::Mat(values).copyTo(View(image));
    for (float& value : image.data) {
      if (value == absent) value = static_cast<float>(box.min().z());
    }
    return image;
  };
  cv::Mat low, opened;
  for (size_t r = 0; r < kGroundRadii_m.size(); ++r) {
    const cv::Mat disc = Disc(kGroundRadii_m[r], cell_m_);
    cv::erode(View(top_or_high), low, disc, {-1, -1}, 1, cv::BORDER_CONSTANT, cv::Scalar(kNone));
    low.setTo(-kNone, low == kNone);
    cv::dilate(low, opened, disc, {-1, -1}, 1, cv::BORDER_CONSTANT, cv::Scalar(-kNone));
    ground_[r] = filled(opened, -kNone);
  }
  for (size_t r = 0; r < kReliefRadii_m.size(); ++r) {
    const cv::Mat disc = Disc(kReliefRadii_m[r], cell_m_);
    cv::erode(View(top_or_high), low, disc, {-1, -1}, 1, cv::BORDER_CONSTANT, cv::Scalar(kNone));
    lowest_[r] = filled(low, kNone);
    cv::dilate(View(top), opened, disc, {-1, -1}, 1, cv::BORDER_CONSTANT, cv::Scalar(-kNone));
    highest_[r] = filled(opened, -kNone);
  }
}

float MeshSurface::At(const FloatImage& plane, const Eigen::Vector2d& position_m) const {
  const Eigen::Vector2d cell = (position_m - low_m_) / cell_m_;
  const int x = std::clamp(static_cast<int>(cell.x()), 0, plane.width - 1);
  const int y = std::clamp(static_cast<int>(cell.y()), 0, plane.height - 1);
  return plane.at(x, y);
}

MeshSurface::SurfaceHit MeshSurface::Cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const {
  SurfaceHit result;
  const RayHit hit = caster_.Cast(origin, direction);
  if (!hit.hit()) return result;
  result.hit = true;
  const Eigen::Vector3d p = axes_ * (origin + hit.distance * direction);
  const Eigen::Vector3f normal = normals_[hit.face];
  const float towards = -normal.dot(direction.normalized().cast<float>());
  const float side = towards < 0 ? -1.0f : 1.0f;
  result.up_normal = side * normal.dot(axes_.row(2).transpose().cast<float>());
  result.position_m = p.head<2>();
  const float z = static_cast<float>(p.z());
  for (size_t r = 0; r < kGroundRadii_m.size(); ++r) result.above_ground_m[r] = z - At(ground_[r], result.position_m);
  for (size_t r = 0; r < kReliefRadii_m.size(); ++r) {
    result.above_lowest_m[r] = z - At(lowest_[r], result.position_m);
    result.below_highest_m[r] = At(highest_[r], result.position_m) - z;
  }
  return result;
}

}  // namespace tessera
