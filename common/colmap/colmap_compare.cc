#include "common/colmap/colmap_compare.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>
#include <utility>

#include "absl/strings/str_format.h"

namespace tessera {
namespace {

constexpr double kDegree_rad = std::numbers::pi / 180;
constexpr double kRounding_m = 1e-3, kRoundingShare = 1e-9, kRounding_rad = 1e-3 * kDegree_rad;
constexpr double kRounding_px = 1e-2;

double LensDifference_px(const LensModel& a, const LensModel& b) {
  const PinholeCamera &p = a.pinhole, &q = b.pinhole;
  if (p.width != q.width || p.height != q.height)
    return std::max(std::abs(p.width - q.width), std::abs(p.height - q.height));
  double difference_px =
      std::max({std::abs(p.fx - q.fx), std::abs(p.fy - q.fy), std::abs(p.cx - q.cx), std::abs(p.cy - q.cy)});
  for (const double x : {0.0, 0.5, 1.0}) {
    for (const double y : {0.0, 0.5, 1.0}) {
      const Eigen::Vector2d position(x * p.width, y * p.height);
      const double distance_px = (a.Distort(position) - b.Distort(position)).norm();
      difference_px = std::isfinite(distance_px) ? std::max(difference_px, distance_px) : difference_px;
    }
  }
  return difference_px;
}

}  // namespace

RigidPose PoseOf(const CalibratedImage& image) {
  return {image.rotation_cam_from_world, image.translation_cam_from_world};
}

RigidPose Chain(const RigidPose& second, const RigidPose& first) {
  return {second.rotation * first.rotation, second.rotation * first.translation + second.translation};
}

PoseDifference ComparePoses(const RigidPose& a, const RigidPose& b) {
  PoseDifference difference;
  const Eigen::Vector3d centre = a.Centre();
  difference.centre_m = (centre - b.Centre()).norm();
  difference.angle_rad = Eigen::AngleAxisd(Eigen::Matrix3d(a.rotation * b.rotation.transpose())).angle();
  difference.exceeds_rounding =
      difference.centre_m > kRounding_m + kRoundingShare * centre.norm() || difference.angle_rad > kRounding_rad;
  return difference;
}

ModelDifference CompareModels(const CalibratedImages& a, const CalibratedImages& b) {
  ModelDifference difference;
  std::map<std::string, const CalibratedImage*> left;
  for (const CalibratedImage& image : b.images) left.emplace(image.name, &image);
  std::set<std::pair<uint32_t, uint32_t>> cameras;  // compared
  for (const CalibratedImage& image : a.images) {
    const auto other = left.find(image.name);
    if (other == left.end()) {
      ++difference.unmatched;
      continue;
    }
    const PoseDifference of_pose = ComparePoses(PoseOf(image), PoseOf(*other->second));
    difference.centre_m = std::max(difference.centre_m, of_pose.centre_m);
    difference.angle_rad = std::max(difference.angle_rad, of_pose.angle_rad);
    difference.exceeds_rounding |= of_pose.exceeds_rounding;
    if (cameras.emplace(image.camera_id, other->second->camera_id).second) {
      difference.image_px = std::max(difference.image_px, LensDifference_px(a.cameras.at(image.camera_id),
                                                                            b.cameras.at(other->second->camera_id)));
    }
    left.erase(other);
  }
  difference.unmatched += static_cast<int64_t>(left.size());
  difference.exceeds_rounding |= difference.unmatched > 0 || difference.image_px > kRounding_px;
  return difference;
}

std::string DistanceText(double centre_m, double angle_rad) {
  return absl::StrFormat("%.3f m and %.3f degrees", centre_m, angle_rad / kDegree_rad);
}

}  // namespace tessera
