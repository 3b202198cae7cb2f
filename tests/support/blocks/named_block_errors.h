// Compares a block that was read with the block that was written, image by image of the same name, whatever their
// order.
#pragma once

#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "common/blocks/block.h"
#include "tests/support/blocks/project_in_block.h"

namespace tessera {

// Largest differences; infinite for images of `read` that `truth` lacks.
struct NamedBlockErrors {
  double centre = 0;           // units of the block
  double rotation = 0;         // of elements
  double reprojection_px = 0;  // of the written points through the cameras that were read
  double observation_px = 0;   // of observations of the same point in the same image
  size_t images = 0, observations = 0;
};

// Sets the observations to where the cameras of the block show its points.
inline void ObserveAgain(ImportedBlock* block) {
  for (BlockTiePoint& point : block->points) {
    for (BlockObservation& observation : point.observations)
      observation.position_px = ProjectInBlock(*block, block->images[observation.image], point.position);
  }
}

// The positions of `read` without its offset are those of `truth`.
inline NamedBlockErrors CompareByName(const ImportedBlock& read, const ImportedBlock& truth) {
  NamedBlockErrors errors;
  std::map<std::string, const BlockImage*> images;
  for (const BlockImage& image : read.images) images[image.path] = &image;
  errors.images = images.size();
  for (const BlockImage& image : truth.images) {
    const auto found = images.find(image.path);
    if (found == images.end()) {
      errors.centre = errors.rotation = HUGE_VAL;
      continue;
    }
    errors.centre = std::max(errors.centre, (found->second->centre - image.centre).norm());
    errors.rotation =
        std::max(errors.rotation,
                 (found->second->rotation_cam_from_block - image.rotation_cam_from_block).cwiseAbs().maxCoeff());
    for (const BlockTiePoint& point : truth.points) {
      for (const BlockObservation& observation : point.observations) {
        if (&truth.images[observation.image] != &image) continue;
        const Eigen::Vector2d position = ProjectInBlock(read, *found->second, point.position);
        errors.reprojection_px = std::max(errors.reprojection_px, (position - observation.position_px).norm());
      }
    }
  }
  for (const BlockTiePoint& point : read.points) {
    for (const BlockTiePoint& written : truth.points) {
      if ((written.position - point.position).norm() > 1e-6) continue;
      for (const BlockObservation& a : point.observations) {
        for (const BlockObservation& b : written.observations) {
          if (read.images[a.image].path != truth.images[b.image].path) continue;
          errors.observation_px = std::max(errors.observation_px, (a.position_px - b.position_px).norm());
          ++errors.observations;
        }
      }
    }
  }
  return errors;
}

inline size_t ObservationsOf(const ImportedBlock& block) {
  size_t count = 0;
  for (const BlockTiePoint& point : block.points) count += point.observations.size();
  return count;
}

}  // namespace tessera
