#include "common/render/framing.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace tessera {
namespace {

constexpr double kBorder = 1.03;  // margin around the mesh

// Columns: the two horizontal axes and up. The first two are the frame's own x and y where up is z.
Eigen::Matrix3d LevelAxes(const Eigen::Vector3d& up) {
  return Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), up).toRotationMatrix();
}

// The nearest camera with these axes (rows: right, down, forward) that has the whole mesh in its image.
PosedCamera Fit(const TriangleMesh& mesh, const Eigen::Matrix3d& cam_from_world, double view_angle_rad, int width_px,
                int height_px) {
  PosedCamera camera;
  const double focal = 0.5 * std::max(width_px, height_px) / std::tan(0.5 * view_angle_rad);
  camera.intrinsics = {width_px, height_px, focal, focal, 0.5 * width_px, 0.5 * height_px};
  camera.rotation_cam_from_world = cam_from_world;
  // Each side of the image bounds the vertices by a plane of slope s: the camera centre (x, z) must satisfy
  // |X - x| <= s (Z - z) for all vertices (X, Z).
  const double slope_x = 0.5 * width_px / focal / kBorder, slope_y = 0.5 * height_px / focal / kBorder;
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  double left = kInfinity, right = -kInfinity, top = kInfinity, bottom = -kInfinity, front = kInfinity;
  for (const Triangle& face : mesh.faces) {
    for (uint32_t v : face) {
      const Eigen::Vector3d p = cam_from_world * mesh.vertices[v];
      left = std::min(left, p.x() + slope_x * p.z());
      right = std::max(right, p.x() - slope_x * p.z());
      top = std::min(top, p.y() + slope_y * p.z());
      bottom = std::max(bottom, p.y() - slope_y * p.z());
      front = std::min(front, p.z());
    }
  }
  double z = std::min((left - right) / (2 * slope_x), (top - bottom) / (2 * slope_y));
  z = std::min(z, front - 1e-6 * (1 + std::abs(front)));
  camera.translation_cam_from_world = -Eigen::Vector3d(0.5 * (left + right), 0.5 * (top + bottom), z);
  return camera;
}

}  // namespace

PosedCamera NadirCamera(const TriangleMesh& mesh, const Eigen::Vector3d& up, int width_px, int height_px) {
  const Eigen::Matrix3d axes = LevelAxes(up);
  Eigen::Matrix3d cam_from_world;
  cam_from_world << axes.col(0).transpose(), -axes.col(1).transpose(), -axes.col(2).transpose();
  return Fit(mesh, cam_from_world, std::numbers::pi / 18, width_px, height_px);
}

PosedCamera ObliqueCamera(const TriangleMesh& mesh, const Eigen::Vector3d& up, double azimuth_rad, double pitch_rad,
                          int width_px, int height_px) {
  const Eigen::Matrix3d axes = LevelAxes(up);
  const Eigen::Vector3d ahead = std::sin(azimuth_rad) * axes.col(0) + std::cos(azimuth_rad) * axes.col(1);
  const Eigen::Vector3d right = std::cos(azimuth_rad) * axes.col(0) - std::sin(azimuth_rad) * axes.col(1);
  const Eigen::Vector3d forward = std::cos(pitch_rad) * ahead - std::sin(pitch_rad) * axes.col(2);
  Eigen::Matrix3d cam_from_world;
  cam_from_world << right.transpose(), forward.cross(right).transpose(), forward.transpose();
  return Fit(mesh, cam_from_world, std::numbers::pi / 6, width_px, height_px);
}

PinholeCamera Zoomed(const PinholeCamera& camera, double x, double y, double share) {
  PinholeCamera zoomed = camera;
  zoomed.fx = camera.fx / share;
  zoomed.fy = camera.fy / share;
  zoomed.cx = (camera.cx - x * camera.width) / share + 0.5 * camera.width;
  zoomed.cy = (camera.cy - y * camera.height) / share + 0.5 * camera.height;
  return zoomed;
}

}  // namespace tessera
