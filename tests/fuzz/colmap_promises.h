// What both forms of COLMAP's models promise.
#pragma once

#include <Eigen/LU>
#include <cmath>
#include <string>
#include <vector>

#include "common/scene/colmap.h"
#include "tests/fuzz/frames.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// True if all three were taken without a fault.
inline bool RunColmapTarget(const std::string& bytes, decltype(&ParseColmapText) parse) {
  std::vector<InputFrame> files = SplitFrames(bytes);
  files.resize(3);
  bool good = true;
  for (const CalibrationContent content : {CalibrationContent::kCameras, CalibrationContent::kCamerasAndPoints}) {
    CalibratedImages model;
    Faults faults;
    parse(files[0].bytes, files[1].bytes, files[2].bytes, "folder", content, &model, &faults);
    good = Accepted(faults);
    for (const auto& [id, lens] : model.cameras) {
      Require(lens.pinhole.width > 0 && lens.pinhole.height > 0, "cameras have pixels");
      Require(lens.pinhole.fx > 0 && lens.pinhole.fy > 0, "cameras have focal lengths");
      for (const double coefficient : lens.coefficients) Require(std::isfinite(coefficient), "lenses are finite");
    }
    for (size_t i = 0; i < model.images.size(); ++i) {
      const CalibratedImage& image = model.images[i];
      Require(i == 0 || model.images[i - 1].id <= image.id, "images are in order");
      Require(image.rotation_cam_from_world.allFinite() && image.translation_cam_from_world.allFinite(),
              "poses are finite");
      Require(std::abs(image.rotation_cam_from_world.determinant() - 1) < 1e-6, "rotations are rotations");
      if (good) Require(model.cameras.contains(image.camera_id), "images have cameras");
    }
    for (const TiePoint& point : model.points) Require(point.position.allFinite(), "points are finite");
  }
  return good;
}

}  // namespace tessera
