// Compares a block that a reader returned with the truth that was written.
#pragma once

#include <gtest/gtest.h>

#include "common/blocks/block.h"
#include "tests/support/blocks/project_in_block.h"
#include "tests/support/blocks/truth_block.h"

namespace tessera {

// Replaces the lenses of a block of pinhole cameras; observations become distorted. `lens` has the coefficients of all.
inline void DistortTruth(const LensModel& lens, double aspect_ratio, ImportedBlock* truth) {
  for (BlockCamera& camera : truth->cameras) {
    PinholeCamera pinhole = camera.lens.pinhole;
    pinhole.fy = pinhole.fx * aspect_ratio;
    const double old_fy = camera.lens.pinhole.fy;
    for (BlockTiePoint& point : truth->points) {
      for (BlockObservation& seen : point.observations) {
        if (&truth->cameras[truth->images[seen.image].camera] != &camera) continue;
        seen.position_px.y() = (seen.position_px.y() - pinhole.cy) * pinhole.fy / old_fy + pinhole.cy;
        LensModel with = lens;
        with.pinhole = pinhole;
        seen.position_px = with.Distort(seen.position_px);
      }
    }
    camera.lens = lens;
    camera.lens.pinhole = pinhole;
  }
}

// The largest distance of an observation of `points` from its point's position in the photograph of `block`, pixels.
inline double LargestResidual_px(const ImportedBlock& block, const std::vector<BlockTiePoint>& points) {
  double largest = 0;
  for (const BlockTiePoint& point : points) {
    for (const BlockObservation& seen : point.observations) {
      const Eigen::Vector2d p = ProjectInBlock(block, block.images[seen.image], point.position);
      largest = std::max(largest, (p - seen.position_px).norm());
    }
  }
  return largest;
}

// Poses, cameras and points agree: centres to 0.1 mm, rotations to 1e-7, positions in photographs to 0.01 pixels.
// `point_error_m`: of the points' positions, which some formats round.
inline void ExpectBlockNear(const ImportedBlock& block, const ImportedBlock& truth, double point_error_m = 1e-4) {
  ASSERT_EQ(block.images.size(), truth.images.size());
  for (size_t i = 0; i < truth.images.size(); ++i) {
    const BlockImage &image = block.images[i], &wanted = truth.images[i];
    ASSERT_EQ(image.oriented, wanted.oriented) << i;
    if (!image.oriented) continue;
    EXPECT_LE((image.centre - wanted.centre).norm(), 1e-4) << i;
    EXPECT_LE((image.rotation_cam_from_block - wanted.rotation_cam_from_block).norm(), 1e-7) << i;
    const PinholeCamera &camera = block.cameras[image.camera].lens.pinhole,
                        &other = truth.cameras[wanted.camera].lens.pinhole;
    EXPECT_EQ(camera.width, other.width);
    EXPECT_EQ(camera.height, other.height);
  }
  EXPECT_LE(LargestResidual_px(block, truth.points), 0.01);
  if (block.points.empty()) return;
  ASSERT_EQ(block.points.size(), truth.points.size());
  for (size_t i = 0; i < truth.points.size(); ++i) {
    const BlockTiePoint &point = block.points[i], &wanted = truth.points[i];
    EXPECT_LE((point.position - wanted.position).norm(), point_error_m) << i;
    ASSERT_EQ(point.observations.size(), wanted.observations.size()) << i;
    for (size_t k = 0; k < wanted.observations.size(); ++k) {
      EXPECT_EQ(point.observations[k].image, wanted.observations[k].image);
      EXPECT_LE((point.observations[k].position_px - wanted.observations[k].position_px).norm(), 1e-3);
    }
  }
}

}  // namespace tessera
