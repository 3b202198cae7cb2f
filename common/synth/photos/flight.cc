#include "common/synth/photos/flight.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"
#include "common/base/random.h"

namespace tessera {
namespace {

constexpr double kFocalPerWidth = 1.1;         // nadir
constexpr double kObliqueFocalPerWidth = 1.4;  // gives about the nadir GSD in the image centre
constexpr double kTiltRad = 0.7853981633974483;

}  // namespace

std::vector<SynthView> PlanFlight(const CityPlan& plan, int width_px, int height_px) {
  return PlanFlightOver(plan, {Eigen::Vector2d(plan.MinX(), plan.MinY()), Eigen::Vector2d(plan.MaxX(), plan.MaxY())},
                        plan.seed ^ 0x666c69676874ull, "", width_px, height_px);
}

std::vector<SynthView> PlanFlightOver(const CityPlan& plan, const Eigen::AlignedBox2d& area, uint64_t seed,
                                      const std::string& prefix, int width_px, int height_px) {
  const double height_m = plan.gsd_m * kFocalPerWidth * width_px;
  const double forward_m = (1 - kForwardOverlap) * height_px * plan.gsd_m;
  const double side_m = (1 - kSideOverlap) * width_px * plan.gsd_m;
  const int lines = std::max(1, static_cast<int>(std::ceil(area.sizes().x() / side_m - 0.25)));
  const int stations = std::max(3, static_cast<int>(std::ceil(area.sizes().y() / forward_m - 0.25)));
  Random random(seed);
  std::vector<SynthView> views;
  static const char* const kNames[kDirections] = {"nadir", "north", "east", "south", "west"};
  for (int line = 0; line < lines; ++line) {
    for (int station = 0; station < stations; ++station) {
      const Eigen::Vector2d over = area.center() + Eigen::Vector2d((line - 0.5 * (lines - 1)) * side_m,
                                                                   (station - 0.5 * (stations - 1)) * forward_m);
      for (int direction = 0; direction < kDirections; ++direction) {
        SynthView view;
        view.stem = absl::StrFormat("%s%s_%02d_%03d", prefix, kNames[direction], line, station);
        view.direction = direction;
        // Aircraft drift: 1 % of the height in position, one degree in attitude.
        view.target = over + 0.006 * height_m * Eigen::Vector2d(random.Uniform(-1, 1), random.Uniform(-1, 1));
        const Eigen::Vector3d target(view.target.x(), view.target.y(), TerrainHeight(plan, over.x(), over.y()));
        const double sky[kDirections][2] = {{0, 0}, {0, 1}, {1, 0}, {0, -1}, {-1, 0}};
        const Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
        Eigen::Vector3d right, forward;
        Eigen::Vector3d centre = target + up * height_m * random.Uniform(0.985, 1.015);
        if (direction == 0) {
          right = Eigen::Vector3d::UnitX();
          forward = -up;
        } else {
          const Eigen::Vector3d heading(sky[direction][0], sky[direction][1], 0);
          right = heading.cross(up);
          forward = std::sin(kTiltRad) * heading - std::cos(kTiltRad) * up;
          centre -= heading * height_m * std::tan(kTiltRad);
        }
        Eigen::Matrix3d rotation;
        rotation.row(0) = right.transpose();
        rotation.row(1) = forward.cross(right).transpose();
        rotation.row(2) = forward.transpose();
        const Eigen::AngleAxisd drift(random.Uniform(-0.02, 0.02), Eigen::Vector3d::UnitZ());
        const Eigen::AngleAxisd roll(random.Uniform(-0.008, 0.008), Eigen::Vector3d::UnitX());
        rotation = (drift * roll).toRotationMatrix() * rotation;
        const double focal = width_px * (direction == 0 ? kFocalPerWidth : kObliqueFocalPerWidth);
        view.camera.intrinsics = {width_px, height_px, focal, focal, 0.5 * width_px, 0.5 * height_px};
        view.camera.rotation_cam_from_world = rotation;
        view.camera.translation_cam_from_world = -rotation * centre;
        views.push_back(std::move(view));
      }
    }
  }
  return views;
}

}  // namespace tessera
