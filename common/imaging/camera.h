// Cameras: pinhole intrinsics, poses, and the lens distortions of COLMAP.
#ifndef TESSERA_COMMON_IMAGING_CAMERA_H_
#define TESSERA_COMMON_IMAGING_CAMERA_H_

#include <Eigen/Core>
#include <string>

namespace tessera {

// Undistorted pinhole camera, pixels. As in COLMAP the centre of the top left pixel is (0.5, 0.5); x right, y down,
// z forward.
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
  // Pixel coordinates (x, y) and depth z in metres. x and y mean nothing where z <= 0.
  Eigen::Vector3d Project(const Eigen::Vector3d& p) const {
    const Eigen::Vector3d c = CameraFromWorld(p);
    return {intrinsics.fx * c.x() / c.z() + intrinsics.cx, intrinsics.fy * c.y() / c.z() + intrinsics.cy, c.z()};
  }
  // Direction in the world frame of the ray through pixel coordinates (x, y), with unit z in the camera's frame.
  Eigen::Vector3d Ray(double x, double y) const {
    return rotation_cam_from_world.transpose() *
           Eigen::Vector3d((x - intrinsics.cx) / intrinsics.fx, (y - intrinsics.cy) / intrinsics.fy, 1.0);
  }
  bool InImage(const Eigen::Vector3d& projected) const {
    return projected.z() > 0 && projected.x() >= 0 && projected.y() >= 0 && projected.x() < intrinsics.width &&
           projected.y() < intrinsics.height;
  }
};

// COLMAP's camera models that Tessera reads. The distorted image has the size and fx, fy, cx, cy of `pinhole`; an
// image is undistorted onto `pinhole` itself.
struct LensModel {
  enum class Kind { kPinhole, kSimpleRadial, kRadial, kOpenCv, kFullOpenCv };
  Kind kind = Kind::kPinhole;
  PinholeCamera pinhole;
  // k1 k2 p1 p2 k3 k4 k5 k6 in COLMAP's (and OpenCV's) order; what a model lacks is zero.
  double coefficients[8] = {};
  bool operator==(const LensModel&) const = default;

  // Position in the distorted image (pixels) of the undistorted pixel position `p`.
  Eigen::Vector2d Distort(const Eigen::Vector2d& p) const;
};

}  // namespace tessera

#endif  // TESSERA_COMMON_IMAGING_CAMERA_H_
