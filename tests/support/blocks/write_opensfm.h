// Writes blocks as OpenSfM does, by its documentation (opensfm.org/docs/geometry.html, dataset.html).
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/blocks/block.h"

namespace tessera {

inline std::string SfmNumbers(const Eigen::Vector3d& v) {
  return absl::StrFormat("[%.17g, %.17g, %.17g]", v.x(), v.y(), v.z());
}

// "rotation": ..., "translation": ..., of a pose world -> camera.
inline std::string SfmPoseText(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& translation) {
  const Eigen::AngleAxisd turn(rotation);
  return absl::StrCat("\"rotation\": ", SfmNumbers(turn.angle() * turn.axis()),
                      ", \"translation\": ", SfmNumbers(translation));
}

// A brown camera; perspective, simple_radial or radial if `type` says so.
inline std::string SfmCameraText(const LensModel& lens, const std::string& type) {
  const PinholeCamera& p = lens.pinhole;
  const double m = std::max(p.width, p.height);
  const double* c = lens.coefficients;
  std::string text = absl::StrFormat("{\"projection_type\": \"%s\", \"width\": %d, \"height\": %d, \"k1\": %.17g", type,
                                     p.width, p.height, c[0]);
  if (type == "perspective") {
    text += absl::StrFormat(", \"focal\": %.17g", p.fx / m);
  } else {
    text += absl::StrFormat(", \"focal_x\": %.17g, \"focal_y\": %.17g, \"c_x\": %.17g, \"c_y\": %.17g", p.fx / m,
                            p.fy / m, (p.cx - p.width / 2.0) / m, (p.cy - p.height / 2.0) / m);
  }
  if (type != "simple_radial") text += absl::StrFormat(", \"k2\": %.17g", c[1]);
  if (type == "brown") text += absl::StrFormat(", \"p1\": %.17g, \"p2\": %.17g, \"k3\": %.17g", c[2], c[3], c[4]);
  return text + "}";
}

struct OpenSfmWriting {
  std::string camera_type = "brown";
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();  // subtracted from all positions
  std::string more;   // further members of the reconstruction, such as "\"reference_lla\": {...}, "
  bool rigs = false;  // poses only by rigs: a rig camera for each camera, an instance for each image
};

// One element of reconstruction.json.
inline std::string OpenSfmReconstruction(const ImportedBlock& block, const OpenSfmWriting& how = {}) {
  const auto list = [](const auto& items, const auto& write) {
    std::string text;
    for (size_t i = 0; i < items.size(); ++i) text += absl::StrCat(i > 0 ? ", " : "", write(items[i], i));
    return text;
  };
  std::string shots = list(block.images, [&](const BlockImage& image, size_t) {
    const Eigen::Matrix3d& R = image.rotation_cam_from_block;
    const Eigen::Vector3d t = -(R * (image.centre - how.offset));
    return absl::StrFormat("\"%s\": {\"camera\": \"%s\", \"orientation\": 1%s}", image.path,
                           block.cameras[image.camera].name, how.rigs ? "" : ", " + SfmPoseText(R, t));
  });
  std::string text =
      absl::StrCat("{", how.more, "\"cameras\": {",
                   list(block.cameras,
                        [&](const BlockCamera& c, size_t) {
                          return absl::StrCat("\"", c.name, "\": ", SfmCameraText(c.lens, how.camera_type));
                        }),
                   "}, \"shots\": {", shots, "}, \"points\": {",
                   list(block.points,
                        [&](const BlockTiePoint& point, size_t i) {
                          return absl::StrCat("\"", i, "\": {\"color\": [1.0, 2.0, 3.0], \"coordinates\": ",
                                              SfmNumbers(point.position - how.offset), "}");
                        }),
                   "}");
  if (how.rigs) {
    // A camera k of the rig is turned and moved; the instance has the rest of the shot's pose.
    const auto of_camera = [](int k) { return Eigen::AngleAxisd(0.3 + k, Eigen::Vector3d(1, 2, -1).normalized()); };
    const auto moved = [](int k) { return Eigen::Vector3d(0.5, -0.2 * k, 0.1); };
    text += absl::StrCat(
        ", \"rig_cameras\": {",
        list(block.cameras,
             [&](const BlockCamera&, size_t k) {
               const int n = static_cast<int>(k);
               return absl::StrCat("\"rig ", k, "\": {", SfmPoseText(of_camera(n).toRotationMatrix(), moved(n)), "}");
             }),
        "}, \"rig_instances\": {",
        list(block.images,
             [&](const BlockImage& image, size_t i) {
               const Eigen::Matrix3d back = of_camera(image.camera).toRotationMatrix().transpose();
               const Eigen::Matrix3d& R = image.rotation_cam_from_block;
               const Eigen::Vector3d t = -(R * (image.centre - how.offset));
               return absl::StrCat("\"", i, "\": {", SfmPoseText(back * R, back * (t - moved(image.camera))),
                                   ", \"rig_camera_ids\": {\"", image.path, "\": \"rig ", image.camera, "\"}}");
             }),
        "}");
  }
  return text + "}";
}

// tracks.csv of `version` 0, 1 or 2.
inline std::string OpenSfmTracks(const ImportedBlock& block, int version = 2) {
  std::string text = version == 0 ? "" : absl::StrCat("OPENSFM_TRACKS_VERSION_v", version, "\n");
  for (size_t i = 0; i < block.points.size(); ++i) {
    for (const BlockObservation& o : block.points[i].observations) {
      const PinholeCamera& p = block.cameras[block.images[o.image].camera].lens.pinhole;
      const double m = std::max(p.width, p.height);
      text += absl::StrFormat("%s\t%d\t7\t%.17g\t%.17g%s\t10\t20\t30%s\n", block.images[o.image].path, i,
                              (o.position_px.x() - p.width / 2.0) / m, (o.position_px.y() - p.height / 2.0) / m,
                              version > 0 ? "\t0.001" : "", version > 1 ? "\t-1\t-1" : "");
    }
  }
  return text;
}

}  // namespace tessera
