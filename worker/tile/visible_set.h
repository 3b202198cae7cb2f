// Finds which ground cells of the city, and which part of each image, the pixels of a tile can depend on.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <span>
#include <vector>

#include "common/job/ground.h"
#include "common/job/survey.h"
#include "worker/visibility/image_window.h"

namespace tessera {

struct VisibleSetOptions {
  double motion_m = 0;          // bound of a vertex's distance from its place in the boxes
  int reference_margin_px = 0;  // ReferenceMargin_px, TargetMargin_px of the job's windows and levels
  int target_margin_px = 0;
  int alignment_px = 1;  // corners of windows are multiples of this
};

struct VisibleSet {
  std::vector<uint8_t> cells;      // per survey cell: 1 if a needed pixel may show one of its faces
  std::vector<PixelRect> windows;  // per view of `views`: smallest window with all needed pixels; may be empty
};

// FindVisibleCells for the core's cells, each in the views selected for it. Boxes are enlarged by the motion, so the
// result holds for all positions of the vertices. `views`: survey indices, ascending; `core`: one flag per survey
// cell; `boxes`: of the faces of each survey cell; empty: the survey's, which are those of the start.
VisibleSet FindVisibleSet(const Survey& survey, const std::vector<uint8_t>& core, const std::vector<int32_t>& views,
                          const VisibleSetOptions& options, std::span<const Eigen::AlignedBox3d> boxes = {});

}  // namespace tessera
