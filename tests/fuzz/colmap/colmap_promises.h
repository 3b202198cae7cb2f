// What both forms of COLMAP's models promise.
#pragma once

#include <Eigen/LU>
#include <cmath>
#include <string>
#include <vector>

#include "common/colmap/colmap.h"
#include "common/colmap/colmap_frames.h"
#include "tests/fuzz/frames.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// True if all files were taken without a fault. Rigs and frames may be missing.
inline bool RunColmapTarget(const std::string& bytes, decltype(&ParseColmapText) parse,
                            decltype(&ParseColmapFramesText) parse_frames) {
  std::vector<InputFrame> files = SplitFrames(bytes);
  const bool has_frames = files.size() > 4;
  files.resize(5);
  bool good = true, good_frames = true;
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
    if (!has_frames) continue;
    Faults of_frames;
    const ColmapFrames frames = parse_frames(files[3].bytes, files[4].bytes, "folder", &of_frames);
    good_frames = Accepted(of_frames);
    for (const auto& [camera, pose] : frames.cam_from_rig) {
      Require(pose.rotation.allFinite() && pose.translation.allFinite(), "poses in rigs are finite");
    }
    for (const ColmapFrames::Image& image : frames.images) {
      Require(image.rig_from_world.translation.allFinite(), "poses of rigs are finite");
    }
    Faults different;
    CompareWithFrames(model, frames, "folder", ".txt", &different);
    good_frames = Accepted(different) && good_frames;
  }
  return good && good_frames;
}

}  // namespace tessera
