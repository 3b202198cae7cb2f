// The cameras of BlocksExchange: its optical properties of photogroups and its axes.
#pragma once

#include <Eigen/Core>

#include "common/blocks/block.h"
#include "common/storage/xml_file.h"

namespace tessera {

// A photogroup's camera, with what its poses and positions in millimetres need.
struct ExchangeCamera {
  BlockCamera camera;
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  // x_cam = axes x, x in the axes of CameraOrientation
  double pixel_mm = 0;                                 // 0: unknown
  double aspect_ratio = 1;

  // Pixels, right and down, of a difference in millimetres along the axes of CameraOrientation.
  Eigen::Vector2d PixelsOf(const Eigen::Vector2d& mm) const;
};

// Reads a Photogroup. False with faults if something is missing or wrong.
bool ReadExchangeCamera(const XmlNode& group, ExchangeCamera* camera, Faults* faults);

}  // namespace tessera
