// Writes blocks in OpenMVS's interface format, in the order of fields of each version: name, [band, from 4,] size,
// K, R, C of a camera; name, [mask, from 5,] platform, camera, pose, [id, from 3,] [depths, scores, from 7] of an
// image.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdint>
#include <string>

#include "common/blocks/block.h"

namespace tessera {

class OpenMvsBytes {
 public:
  template <class T>
  void Add(T value) {
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof(T));
  }
  void Count(size_t count) { Add<uint64_t>(count); }
  void Text(const std::string& text) {
    Count(text.size());
    bytes_ += text;
  }
  void Rows(const Eigen::MatrixXd& matrix) {
    for (int i = 0; i < matrix.rows(); ++i) {
      for (int k = 0; k < matrix.cols(); ++k) Add<double>(matrix(i, k));
    }
  }
  std::string& bytes() { return bytes_; }

 private:
  std::string bytes_;
};

struct OpenMvsWriting {
  uint32_t version = 7;
  bool normalised = false;    // K in shares of the longer side, no image size
  bool unposed_last = false;  // the last image has no pose
  size_t normals = 0;         // of points
  Eigen::Matrix4d transform = Eigen::Matrix4d::Identity();
};

// One platform with all cameras, each turned and moved on it.
inline std::string WriteOpenMvs(const ImportedBlock& block, const OpenMvsWriting& how = {}) {
  const auto turned = [](int camera) {
    return Eigen::AngleAxisd(0.4 + camera, Eigen::Vector3d(1, -2, 0.5).normalized()).toRotationMatrix();
  };
  const auto moved = [](int camera) { return Eigen::Vector3d(0.3, 1 - camera, -0.2); };
  OpenMvsBytes out;
  out.bytes() = "MVSI";
  out.Add<uint32_t>(how.version);
  out.Add<uint32_t>(0);
  out.Count(1);
  out.Text("platform");
  out.Count(block.cameras.size());
  for (size_t i = 0; i < block.cameras.size(); ++i) {
    const LensModel& lens = block.cameras[i].lens;
    const PinholeCamera& p = lens.pinhole;
    const double unit = how.normalised ? 1.0 / std::max(p.width, p.height) : 1;
    out.Text(block.cameras[i].name);
    if (how.version > 3) out.Text("RGB");
    out.Add<uint32_t>(how.normalised ? 0 : p.width);
    out.Add<uint32_t>(how.normalised ? 0 : p.height);
    Eigen::Matrix3d K = Eigen::Matrix3d::Identity();
    K.topRows<2>() << p.fx * unit, lens.coefficients[6] * unit, (p.cx - 0.5) * unit, 0, p.fy * unit,
        (p.cy - 0.5) * unit;
    out.Rows(K);
    out.Rows(turned(static_cast<int>(i)));
    out.Rows(moved(static_cast<int>(i)));
  }
  out.Count(block.images.size());
  for (const BlockImage& image : block.images) {
    // R = R_camera R_pose, C = R_pose^T C_camera + C_pose
    const Eigen::Matrix3d of_pose = turned(image.camera).transpose() * image.rotation_cam_from_block;
    out.Rows(of_pose);
    out.Rows(image.centre - of_pose.transpose() * moved(image.camera));
  }
  out.Count(block.images.size());
  for (size_t i = 0; i < block.images.size(); ++i) {
    out.Text(block.images[i].path);
    if (how.version > 4) out.Text("mask.png");
    out.Add<uint32_t>(0);
    out.Add<uint32_t>(block.images[i].camera);
    out.Add<uint32_t>(how.unposed_last && i + 1 == block.images.size() ? 0xffffffff : static_cast<uint32_t>(i));
    if (how.version > 2) out.Add<uint32_t>(1000 + static_cast<uint32_t>(i));
    if (how.version > 6) {
      for (const float depth : {10.f, 20.f, 30.f}) out.Add(depth);
      out.Count(1);
      for (int k = 0; k < 6; ++k) out.Add<uint32_t>(0);
    }
  }
  out.Count(block.points.size());
  for (const BlockTiePoint& point : block.points) {
    for (int k = 0; k < 3; ++k) out.Add(static_cast<float>(point.position[k]));
    out.Count(point.observations.size());
    for (const BlockObservation& observation : point.observations) {
      out.Add<uint32_t>(observation.image);
      out.Add<float>(0);
    }
  }
  out.Count(how.normals);
  for (size_t i = 0; i < 3 * how.normals; ++i) out.Add<float>(0);
  out.Count(block.points.size());  // colours
  out.bytes().append(3 * block.points.size(), '\x7f');
  for (int k = 0; k < 3; ++k) out.Count(0);  // lines
  if (how.version > 1) out.Rows(how.transform);
  if (how.version > 5) out.Rows(Eigen::MatrixXd::Zero(15, 1));
  return out.bytes();
}

}  // namespace tessera
