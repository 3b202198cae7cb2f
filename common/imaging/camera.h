// Cameras: pinhole intrinsics, poses, and COLMAP's lens distortion models.
#pragma once

#include <Eigen/Core>
#include <string>

namespace tessera {

// Undistorted pinhole camera; units are pixels. As in COLMAP, the centre of the top left pixel is (0.5, 0.5); x points
// right, y down, z forward.
struct PinholeCamera {
  int width = 0;
  int height = 0;
  double fx = 0, fy = 0;
  double cx = 0, cy = 0;
  bool operator==(const PinholeCamera&) const = default;

  // The same camera for an image of another size (a pyramid level): pixel centres scale with the width and height.
  PinholeCamera Resized(int new_width, int new_height) const {
    const double sx = static_cast<double>(new_width) / width, sy = static_cast<double>(new_height) / height;
    return {new_width, new_height, fx * sx, fy * sy, cx * sx, cy * sy};
  }
};

// A camera with its pose: x_cam = rotation_cam_from_world · X_world + translation_cam_from_world, metres.
struct PosedCamera {
  PinholeCamera intrinsics;
  Eigen::Matrix3d rotation_cam_from_world = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation_cam_from_world = Eigen::Vector3d::Zero();
  bool operator==(const PosedCamera&) const = default;

  Eigen::Vector3d CameraFromWorld(const Eigen::Vector3d& p) const {
    return rotation_cam_from_world * p + translation_cam_from_world;
  }
  // Centre of projection, world frame.
  Eigen::Vector3d Centre() const { return -rotation_cam_from_world.transpose() * translation_cam_from_world; }
  // Pixel coordinates (x, y) and depth z in metres. x and y are undefined where z <= 0.
  Eigen::Vector3d Project(const Eigen::Vector3d& p) const {
    const Eigen::Vector3d c = CameraFromWorld(p);
    return {intrinsics.fx * c.x() / c.z() + intrinsics.cx, intrinsics.fy * c.y() / c.z() + intrinsics.cy, c.z()};
  }
  // Direction (world frame) of the ray through pixel coordinates (x, y); its z in the camera frame is 1.
  Eigen::Vector3d Ray(double x, double y) const {
    return rotation_cam_from_world.transpose() *
           Eigen::Vector3d((x - intrinsics.cx) / intrinsics.fx, (y - intrinsics.cy) / intrinsics.fy, 1.0);
  }
  bool InImage(const Eigen::Vector3d& projected) const {
    return projected.z() > 0 && projected.x() >= 0 && projected.y() >= 0 && projected.x() < intrinsics.width &&
           projected.y() < intrinsics.height;
  }
};

// The supported camera models of COLMAP, and kBrown for imported cameras that COLMAP's models do not cover. The
// distorted and the undistorted image have the same size and the same fx, fy, cx, cy: those of `pinhole`.
struct LensModel {
  enum class Kind { kPinhole, kSimpleRadial, kRadial, kOpenCv, kFullOpenCv, kBrown };
  Kind kind = Kind::kPinhole;
  PinholeCamera pinhole;
  // k1 k2 p1 p2 k3 k4 k5 k6 in the order of COLMAP and OpenCV; coefficients that a model does not have are zero.
  // kBrown: k1 k2 p1 p2 k3 k4 skew, where k4 belongs to r^8; skew (pixels) times the distorted y/z is added to x.
  double coefficients[8] = {};
  bool operator==(const LensModel&) const = default;

  // The position in the distorted image of position `p` in the undistorted image; both in pixels.
  Eigen::Vector2d Distort(const Eigen::Vector2d& p) const;
  // The inverse, by fixed-point iteration to 0.001 px; `p` itself where it does not converge to a finite position.
  Eigen::Vector2d Undistort(const Eigen::Vector2d& p) const;
};

}  // namespace tessera
