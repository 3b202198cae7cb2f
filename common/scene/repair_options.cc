#include "common/scene/repair_options.h"

#include <filesystem>
#include <system_error>

namespace tessera {
namespace {

Viewpoint ViewpointOf(const PosedCamera& camera) {
  const PinholeCamera& in = camera.intrinsics;
  Eigen::Matrix3d calibration;
  calibration << in.fx, 0, in.cx, 0, in.fy, in.cy, 0, 0, 1;
  Viewpoint viewpoint;
  viewpoint.centre = camera.Centre();
  viewpoint.projection << calibration * camera.rotation_cam_from_world, calibration * camera.translation_cam_from_world;
  viewpoint.width_px = in.width;
  viewpoint.height_px = in.height;
  viewpoint.focal_product_px2 = in.fx * in.fy;
  return viewpoint;
}

}  // namespace

RepairOptions RepairOptionsOf(const std::vector<SceneView>& views, const Frame& frame) {
  RepairOptions options;
  for (const SceneView& view : views) {
    if (!view.withdrawn) options.views.push_back(ViewpointOf(view.camera));
  }
  std::error_code error;  // empty if there is none: an error where it is needed
  options.scratch_folder = std::filesystem::temp_directory_path(error).string();
  options.file_origin = frame.LocalFromScene(Eigen::Vector3d::Zero());
  return options;
}

}  // namespace tessera
