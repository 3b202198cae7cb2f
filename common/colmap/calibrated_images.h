// Cameras, poses and tie points of a set of images, as every reader of a camera format returns them. Views are built
// from these.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "common/imaging/camera.h"

namespace tessera {

// An image point with its 3D point.
struct ImageObservation {
  Eigen::Vector2d position_px;  // in the distorted photograph
  uint64_t point_id = 0;
};

// The world is the coordinate system of the scene.
struct CalibratedImage {
  uint32_t id = 0;
  std::string name;  // relative to the images folder
  uint32_t camera_id = 0;
  Eigen::Matrix3d rotation_cam_from_world = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation_cam_from_world = Eigen::Vector3d::Zero();
  std::vector<ImageObservation> observations;  // only image points with a 3D point
};

struct TiePoint {
  uint64_t id = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  std::vector<uint32_t> image_ids;  // the images of its track
};

struct CalibratedImages {
  std::map<uint32_t, LensModel> cameras;
  std::vector<CalibratedImage> images;  // by ascending id
  std::vector<TiePoint> points;         // empty if there are none or they were not requested
  std::vector<std::string> files;       // of cameras and poses: names relative to the folder that was read
};

enum class CalibrationContent { kCameras, kCamerasAndPoints };  // the second adds image points and 3D points

}  // namespace tessera
