// Cameras of RealityScan and RealityCapture: XMP sidecars of images, and tables of camera parameters.
#pragma once

#include <Eigen/Core>
#include <array>
#include <string>

#include "common/base/status.h"
#include "common/blocks/block.h"
#include "common/blocks/block_format.h"
#include "common/blocks/photograph_files.h"

namespace tessera {

bool IsRealityScan(const std::string& path);

// `path`: a folder with images and their sidecars IMAGE.xmp, also in subfolders; one of these sidecars, for its folder;
// or a CSV file of the export "Internal/External camera parameters". Of a folder with both, the sidecars are read.
ImportedBlock ReadRealityScan(const std::string& path, const BlockReadOptions& options, Faults* faults,
                              Warnings* warnings);

// Larger numbers are damage; products of two smaller ones are finite.
inline constexpr double kMaxRealityScanNumber = 1e15;

// What a sidecar or a line of a table states of an image.
struct RealityScanCamera {
  std::string version, component;
  bool has_focal = false, has_rotation = false, has_position = false;
  Eigen::Matrix3d rotation_cam_from_block = Eigen::Matrix3d::Identity();
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  double focal_35mm = 0, principal_u = 0, principal_v = 0, skew = 0, aspect = 1;
  std::array<double, 6> distortion = {};  // k1 k2 k3 k4 t1 t2
};

// The lens in an image of this size.
LensModel RealityScanLens(const RealityScanCamera& camera, const ImageSize& size);

// Parses the sidecar `name`. False if it has no properties of RealityScan, or after a fault.
bool ParseRealityScanXmp(const std::string& bytes, const std::string& name, RealityScanCamera* camera, Faults* faults);

// Whether the file begins with the header of such a table.
bool IsRealityScanCsv(const std::string& path);
// Parses the text of the CSV file `name` and adds its cameras and images.
void ParseRealityScanCsv(const std::string& text, const std::string& name, const PhotographSize& size_of,
                         ImportedBlock* block, Faults* faults);

}  // namespace tessera
