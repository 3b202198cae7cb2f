// Writes blocks as Pix4D's files of camera parameters, from the definition in their header: m = K [R | -R t] X.
#pragma once

#include <Eigen/Dense>
#include <filesystem>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/blocks/block.h"

namespace tessera {

inline Eigen::Matrix3d Pix4dMatrixK(const LensModel& lens) {
  Eigen::Matrix3d k = Eigen::Matrix3d::Identity();
  k(0, 0) = lens.pinhole.fx;
  k(1, 1) = lens.pinhole.fy;
  k(0, 2) = lens.pinhole.cx;
  k(1, 2) = lens.pinhole.cy;
  if (lens.kind == LensModel::Kind::kBrown) k(0, 1) = lens.coefficients[6];
  return k;
}

inline std::string Pix4dRows(const Eigen::Matrix3d& m) {
  std::string text;
  for (int r = 0; r < 3; ++r) absl::StrAppendFormat(&text, "%.20f %.20f %.20f\n", m(r, 0), m(r, 1), m(r, 2));
  return text;
}

// calibrated_camera_parameters.txt; positions less `offset`.
inline std::string Pix4dCameraText(const ImportedBlock& block, const Eigen::Vector3d& offset) {
  std::string text =
      "fileName imageWidth imageHeight \ncamera matrix K [3x3]\nradial distortion [3x1]\n"
      "tangential distortion [2x1]\ncamera position t [3x1]\ncamera rotation R [3x3]\n"
      "camera model m = K [R|-Rt] X\n\n";
  for (const BlockImage& image : block.images) {
    const LensModel& lens = block.cameras[image.camera].lens;
    const auto& [k1, k2, p1, p2, k3, k4, k5, k6] = lens.coefficients;
    const Eigen::Vector3d t = image.centre - offset;
    absl::StrAppend(&text, image.path, " ", lens.pinhole.width, " ", lens.pinhole.height, "\n",
                    Pix4dRows(Pix4dMatrixK(lens)));
    absl::StrAppendFormat(&text, "%.20f %.20f %.20f\n%.20f %.20f\n%.20f %.20f %.20f\n", k1, k2, k3, p1, p2, t.x(),
                          t.y(), t.z());
    text += Pix4dRows(image.rotation_cam_from_block);
  }
  return text;
}

// calibrated_external_camera_parameters.txt, whose angles are not read.
inline std::string Pix4dExternalText(const ImportedBlock& block) {
  std::string text = "imageName X Y Z Omega Phi Kappa\n";
  for (const BlockImage& image : block.images) {
    absl::StrAppendFormat(&text, "%s %.6f %.6f %.6f 1.5 -2 30\n", image.path, image.centre.x(), image.centre.y(),
                          image.centre.z());
  }
  return text;
}

inline std::string Pix4dMatrixText(const ImportedBlock& block, const Eigen::Vector3d& offset) {
  std::string text;
  for (const BlockImage& image : block.images) {
    Eigen::Matrix<double, 3, 4> p;
    p.leftCols<3>() = image.rotation_cam_from_block;
    p.col(3) = -image.rotation_cam_from_block * (image.centre - offset);
    p = Pix4dMatrixK(block.cameras[image.camera].lens) * p;
    text += image.path;
    for (int k = 0; k < 12; ++k) absl::StrAppendFormat(&text, " %.6f", p(k / 4, k % 4));
    text += " \n";
  }
  return text;
}

inline std::string Pix4dTiePointText(const ImportedBlock& block) {
  std::string text;
  for (int i = 0; i < static_cast<int>(block.images.size()); ++i) {
    absl::StrAppend(&text, std::filesystem::path(block.images[i].path).stem().string(), "\n");
    for (size_t p = 0; p < block.points.size(); ++p) {
      for (const BlockObservation& o : block.points[p].observations) {
        if (o.image != i) continue;
        absl::StrAppendFormat(&text, "%d %.9f %.9f 3.5\n", 1000 + p, o.position_px.x(), o.position_px.y());
      }
    }
    text += "-99\n";
  }
  return text;
}

}  // namespace tessera
