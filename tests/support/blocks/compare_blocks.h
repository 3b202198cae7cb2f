// Compares a block that was read from a file with the block that the file was written from.
#pragma once

#include <algorithm>
#include <cmath>

#include "common/blocks/block.h"
#include "tests/support/blocks/project_in_block.h"

namespace tessera {

struct BlockErrors {
  double centre = 0;           // largest distance of centres, units of the block
  double rotation = 0;         // largest difference of elements
  double reprojection_px = 0;  // of truth's points through the cameras that were read, to truth's observations
  double observation_px = 0;   // of observations that were read, through the cameras that were read; 0 without points
};

// Infinite if the numbers of images or points differ. Images are in the same order. `read` may have an offset.
inline BlockErrors CompareBlocks(const ImportedBlock& read, const ImportedBlock& truth) {
  BlockErrors errors;
  if (read.images.size() != truth.images.size() ||
      (!read.points.empty() && read.points.size() != truth.points.size())) {
    errors.centre = errors.rotation = errors.reprojection_px = errors.observation_px = HUGE_VAL;
    return errors;
  }
  for (size_t i = 0; i < truth.images.size(); ++i) {
    const BlockImage &a = read.images[i], &b = truth.images[i];
    errors.centre = std::max(errors.centre, (a.centre + read.offset - b.centre).norm());
    errors.rotation =
        std::max(errors.rotation, (a.rotation_cam_from_block - b.rotation_cam_from_block).cwiseAbs().maxCoeff());
  }
  for (const BlockTiePoint& point : truth.points) {
    for (const BlockObservation& o : point.observations) {
      const Eigen::Vector2d p = ProjectInBlock(read, read.images[o.image], point.position - read.offset);
      errors.reprojection_px = std::max(errors.reprojection_px, (p - o.position_px).norm());
    }
  }
  for (const BlockTiePoint& point : read.points) {
    for (const BlockObservation& o : point.observations) {
      const Eigen::Vector2d p = ProjectInBlock(read, read.images[o.image], point.position);
      errors.observation_px = std::max(errors.observation_px, (p - o.position_px).norm());
    }
  }
  return errors;
}

}  // namespace tessera
