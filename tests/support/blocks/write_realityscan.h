// Writes blocks as RealityScan's sidecars and tables, from the definitions in RealityScan's help.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/blocks/block.h"

namespace tessera {

// The intrinsics that both formats write: 35 mm focal length, principal point, then k1 k2 k3 k4 t1 t2.
struct RealityScanNumbers {
  double focal_35mm, u, v, skew, aspect;
  double k[6];
};

inline RealityScanNumbers RealityScanNumbersOf(const LensModel& lens) {
  const PinholeCamera& p = lens.pinhole;
  const double side = std::max(p.width, p.height);
  RealityScanNumbers n;
  n.focal_35mm = 36 * p.fx / side;
  n.u = (p.cx - 0.5 * p.width) / side;
  n.v = (p.cy - 0.5 * p.height) / side;
  n.aspect = p.fy / p.fx;
  const double* c = lens.coefficients;  // k1 k2 p1 p2 k3 k4 skew
  n.skew = c[6] / side;
  const double k[6] = {c[0], c[1], c[4], c[5], c[3], c[2]};
  for (int i = 0; i < 6; ++i) n.k[i] = k[i];
  return n;
}

// The sidecar of an image; `model`: brown3, brown4t2 and so on.
inline std::string RealityScanSidecar(const ImportedBlock& block, int index, const std::string& model,
                                      const std::string& component = "") {
  const BlockImage& image = block.images[index];
  const RealityScanNumbers n = RealityScanNumbersOf(block.cameras[image.camera].lens);
  std::string rotation, coefficients;
  for (int k = 0; k < 9; ++k) absl::StrAppendFormat(&rotation, "%.16g ", image.rotation_cam_from_block(k / 3, k % 3));
  for (const double k : n.k) absl::StrAppendFormat(&coefficients, "%.16g ", k);
  return absl::StrFormat(
      "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\">\n  <rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">\n"
      "    <rdf:Description xcr:Version=\"3\" xcr:PosePrior=\"locked\" xcr:Coordinates=\"absolute\"%s\n"
      "       xcr:DistortionModel=\"%s\" xcr:FocalLength35mm=\"%.16g\" xcr:Skew=\"%.16g\" xcr:AspectRatio=\"%.16g\"\n"
      "       xcr:PrincipalPointU=\"%.16g\" xcr:PrincipalPointV=\"%.16g\" xcr:CalibrationPrior=\"exact\"\n"
      "       xmlns:xcr=\"http://www.capturingreality.com/ns/xcr/1.1#\">\n"
      "      <xcr:Rotation>%s</xcr:Rotation>\n      <xcr:Position>%.16g %.16g %.16g</xcr:Position>\n"
      "      <xcr:DistortionCoeficients>%s</xcr:DistortionCoeficients>\n    </rdf:Description>\n  </rdf:RDF>\n"
      "</x:xmpmeta>\n",
      component.empty() ? "" : absl::StrCat(" xcr:ComponentId=\"", component, "\""), model, n.focal_35mm, n.skew,
      n.aspect, n.u, n.v, rotation, image.centre.x(), image.centre.y(), image.centre.z(), coefficients);
}

// Heading, pitch and roll in degrees of a rotation from the world to the camera. The transpose, with y up and z back
// instead of y down and z forward, is Rz(-heading) Rx(pitch) Ry(roll).
inline Eigen::Vector3d RealityScanAngles(const Eigen::Matrix3d& rotation) {
  const Eigen::Matrix3d m = rotation.transpose() * Eigen::Vector3d(1, -1, -1).asDiagonal();
  return 180 / 3.14159265358979323846 *
         Eigen::Vector3d(std::atan2(m(0, 1), m(1, 1)), std::asin(m(2, 1)), std::atan2(-m(2, 0), m(2, 2)));
}

// A table with columns in the order of newer templates, or in another one with the names of older templates.
inline std::string RealityScanTable(const ImportedBlock& block, bool is_new) {
  std::string text = is_new ? "#name,x,y,alt,yaw,pitch,roll,f_35mm,px_norm,py_norm,k1,k2,k3,k4,t1,t2\n"
                            : absl::StrCat("#cameras ", block.images.size(),
                                           "\n#name,f,px,py,k1,k2,k3,k4,t1,t2,x,y,alt,heading,pitch,roll\n");
  for (const BlockImage& image : block.images) {
    const RealityScanNumbers n = RealityScanNumbersOf(block.cameras[image.camera].lens);
    const Eigen::Vector3d angles = RealityScanAngles(image.rotation_cam_from_block);
    std::string pose, lens;
    for (const double v : {image.centre.x(), image.centre.y(), image.centre.z(), angles.x(), angles.y(), angles.z()}) {
      absl::StrAppendFormat(&pose, ",%.16g", v);
    }
    for (const double v : {n.focal_35mm, n.u, n.v, n.k[0], n.k[1], n.k[2], n.k[3], n.k[4], n.k[5]}) {
      absl::StrAppendFormat(&lens, ",%.16g", v);
    }
    absl::StrAppend(&text, image.path, is_new ? pose : lens, is_new ? lens : pose, "\n");
  }
  return text;
}

}  // namespace tessera
