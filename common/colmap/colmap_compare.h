// Differences between two models of the same images.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>

#include "common/colmap/calibrated_images.h"

namespace tessera {

struct RigidPose {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Eigen::Vector3d Centre() const { return -rotation.transpose() * translation; }
};
RigidPose PoseOf(const CalibratedImage& image);
// The pose that applies `first` and then `second`.
RigidPose Chain(const RigidPose& second, const RigidPose& first);

struct PoseDifference {
  double centre_m = 0;
  double angle_rad = 0;
  bool exceeds_rounding = false;  // of numbers in text files: 1 mm, for large coordinates more, and a thousandth degree
};
PoseDifference ComparePoses(const RigidPose& a, const RigidPose& b);

struct ModelDifference {
  double centre_m = 0, angle_rad = 0;  // the largest of an image
  double image_px = 0;                 // the largest of a camera: of its parameters, or of distorted positions
  int64_t unmatched = 0;               // images, by name, that one model has and the other lacks
  bool exceeds_rounding = false;
};
ModelDifference CompareModels(const CalibratedImages& a, const CalibratedImages& b);

// "10.000 m and 0.000 degrees": for messages.
std::string DistanceText(double centre_m, double angle_rad);

}  // namespace tessera
