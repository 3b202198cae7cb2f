// A block whose cameras, poses and observations are known, for tests of readers. Writers of each format convert it by
// their own formulas.
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <random>
#include <string>

#include "absl/strings/str_cat.h"
#include "common/blocks/block.h"
#include "tests/support/blocks/project_in_block.h"

namespace tessera {

struct TruthOptions {
  LensModel::Kind lens = LensModel::Kind::kPinhole;  // with coefficients of an aerial camera, those of `lens`
  bool square_pixels = true;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  // of the ground, in the block's coordinates
  int images = 9, points = 60;
  unsigned seed = 1;
};

// Photographs from 120 m above a ground of 200 m, tilted and turned in all directions, by two cameras: one upright, one
// wide. Points are seen in at least two images; observations are exact to rounding.
inline ImportedBlock MakeTruthBlock(const TruthOptions& options = {}) {
  std::mt19937 random(options.seed);
  std::uniform_real_distribution<double> unit(-1, 1);
  ImportedBlock block;
  for (int k = 0; k < 2; ++k) {
    BlockCamera camera;
    camera.name = absl::StrCat("camera ", k);
    PinholeCamera& pinhole = camera.lens.pinhole;
    pinhole.width = k == 0 ? 4000 : 2800;
    pinhole.height = k == 0 ? 3000 : 3600;
    pinhole.fx = 3400 + 150 * k;
    pinhole.fy = options.square_pixels ? pinhole.fx : pinhole.fx * 1.0004;
    pinhole.cx = pinhole.width / 2.0 + 21.4 - 9 * k;
    pinhole.cy = pinhole.height / 2.0 - 17.3 + 6 * k;
    camera.lens.kind = options.lens;
    double* c = camera.lens.coefficients;
    using Kind = LensModel::Kind;
    if (options.lens != Kind::kPinhole) c[0] = -0.08 + 0.01 * k;
    if (options.lens >= Kind::kRadial) c[1] = 0.05;
    if (options.lens >= Kind::kOpenCv) c[2] = 0.0009, c[3] = -0.0006;
    if (options.lens >= Kind::kFullOpenCv) c[4] = -0.02;
    if (options.lens == Kind::kFullOpenCv) c[5] = 0.003, c[6] = 0.002, c[7] = -0.001;
    if (options.lens == Kind::kBrown) c[5] = 0.01, c[6] = 0.7;
    block.cameras.push_back(camera);
  }
  for (int k = 0; k < options.images; ++k) {
    BlockImage image;
    image.path = absl::StrCat("images/", k % 2 == 0 ? "a" : "b", "/IMG_", 100 + k, ".jpg");
    image.location = absl::StrCat("image ", k);
    image.camera = k % 2;
    image.centre = options.centre + Eigen::Vector3d(80 * unit(random), 80 * unit(random), 120 + 10 * unit(random));
    // Down, then tilted by up to 30 degrees, turned by any angle about the vertical.
    const Eigen::Matrix3d down = Eigen::Vector3d(1, -1, -1).asDiagonal();
    image.rotation_cam_from_block = (Eigen::AngleAxisd(0.5 * unit(random), Eigen::Vector3d::UnitX()) *
                                     Eigen::AngleAxisd(0.5 * unit(random), Eigen::Vector3d::UnitY()))
                                        .toRotationMatrix() *
                                    down *
                                    Eigen::AngleAxisd(3.14 * unit(random), Eigen::Vector3d::UnitZ()).toRotationMatrix();
    block.images.push_back(image);
  }
  while (static_cast<int>(block.points.size()) < options.points) {
    BlockTiePoint point;
    point.position = options.centre + Eigen::Vector3d(100 * unit(random), 100 * unit(random), 15 * unit(random));
    for (int k = 0; k < options.images; ++k) {
      const BlockImage& image = block.images[k];
      const LensModel& lens = block.cameras[image.camera].lens;
      const auto [ideal, depth] = IdealInBlock(block, image, point.position);
      if (depth <= 0) continue;
      if (!(ideal.x() > 0 && ideal.y() > 0 && ideal.x() < lens.pinhole.width && ideal.y() < lens.pinhole.height))
        continue;
      point.observations.push_back({k, lens.Distort(ideal)});
    }
    if (point.observations.size() >= 2) block.points.push_back(point);
  }
  return block;
}

}  // namespace tessera
