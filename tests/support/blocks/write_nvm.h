// Writes blocks as NVM, by the formulas of the programs that do.
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/blocks/block.h"

namespace tessera {

// Moves principal points to the middle of the images, as NVM assumes, and observations with them.
inline ImportedBlock WithCentredCameras(ImportedBlock block) {
  for (BlockTiePoint& point : block.points) {
    for (BlockObservation& o : point.observations) {
      const PinholeCamera& p = block.cameras[block.images[o.image].camera].lens.pinhole;
      o.position_px += Eigen::Vector2d(p.width / 2.0 - p.cx, p.height / 2.0 - p.cy);
    }
  }
  for (BlockCamera& camera : block.cameras) {
    camera.lens.pinhole.cx = camera.lens.pinhole.width / 2.0;
    camera.lens.pinhole.cy = camera.lens.pinhole.height / 2.0;
  }
  return block;
}

// Replaces the pinhole observations of the block by those of VisualSFM's lens: the undistorted position is
// (1 + k r^2) times the distorted one. Solves that cubic by Newton's method. Drops those outside the image.
inline ImportedBlock WithInverseRadial(ImportedBlock block, double k) {
  for (BlockTiePoint& point : block.points) {
    for (BlockObservation& o : point.observations) {
      const PinholeCamera& p = block.cameras[block.images[o.image].camera].lens.pinhole;
      const Eigen::Vector2d middle(p.cx, p.cy);
      const double undistorted = (o.position_px - middle).norm() / p.fx;
      double distorted = undistorted;
      for (int i = 0; i < 50; ++i) {
        distorted -=
            (distorted + k * distorted * distorted * distorted - undistorted) / (1 + 3 * k * distorted * distorted);
      }
      if (undistorted > 0) o.position_px = middle + (o.position_px - middle) * (distorted / undistorted);
    }
    std::erase_if(point.observations, [&](const BlockObservation& o) {
      const PinholeCamera& p = block.cameras[block.images[o.image].camera].lens.pinhole;
      return !(o.position_px.x() > 0 && o.position_px.y() > 0 && o.position_px.x() < p.width &&
               o.position_px.y() < p.height);
    });
  }
  return block;
}

enum class NvmDialect { kColmap, kVisualSfm, kOpenSfm };

// `radial`: written for each image.
inline std::string NvmText(const ImportedBlock& block, NvmDialect dialect, double radial,
                           const std::string& header = "NVM_V3", bool has_matrices = false) {
  std::string text = absl::StrCat(header, " \n \n", block.images.size(), "  \n");
  for (const BlockImage& image : block.images) {
    const Eigen::Quaterniond q(image.rotation_cam_from_block);
    const Eigen::Vector3d t = -(image.rotation_cam_from_block * image.centre);
    absl::StrAppend(&text, image.path, absl::StrFormat(" %.17g", block.cameras[image.camera].lens.pinhole.fx));
    if (has_matrices) {
      for (int k = 0; k < 9; ++k) absl::StrAppendFormat(&text, " %.17g", image.rotation_cam_from_block(k / 3, k % 3));
      absl::StrAppendFormat(&text, " %.17g %.17g %.17g %.17g 0\n", t.x(), t.y(), t.z(), radial);
    } else {
      absl::StrAppendFormat(&text, " %.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g 0\n", q.w(), q.x(), q.y(), q.z(),
                            image.centre.x(), image.centre.y(), image.centre.z(), radial);
    }
  }
  absl::StrAppend(&text, "\n", block.points.size(), "\n");
  for (const BlockTiePoint& point : block.points) {
    absl::StrAppendFormat(&text, "%.17g %.17g %.17g 10 20 30 %d", point.position.x(), point.position.y(),
                          point.position.z(), point.observations.size());
    for (size_t k = 0; k < point.observations.size(); ++k) {
      const BlockObservation& o = point.observations[k];
      const PinholeCamera& p = block.cameras[block.images[o.image].camera].lens.pinhole;
      double x = o.position_px.x(), y = o.position_px.y();
      if (dialect == NvmDialect::kVisualSfm) {
        x -= p.cx;
        y -= p.cy;
      } else if (dialect == NvmDialect::kOpenSfm) {  // x = (0.5 + normalized) width, normalized by the larger side
        const double larger = std::max(p.width, p.height);
        x = (0.5 + (x - 0.5 * p.width) / larger) * p.width;
        y = (0.5 + (y - 0.5 * p.height) / larger) * p.height;
      }
      absl::StrAppendFormat(&text, " %d %d %.17g %.17g", o.image, k, x, y);
    }
    text += "\n";
  }
  return text + "\n0\n\n#the last part of NVM file points to the PLY files\n0\n";
}

}  // namespace tessera
