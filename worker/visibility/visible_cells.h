// Finds which cells of a mesh, and which part of each image, the pixels of given cells can depend on.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

#include "worker/visibility/image_window.h"
#include "worker/visibility/mesh_cells.h"

namespace tessera {

struct VisibleCellsProblem {
  std::vector<Eigen::AlignedBox3d> boxes;     // bounds of each cell's content; vertices may move inside them
  std::vector<CameraWindow> views;            // pixels outside these windows are ignored
  std::vector<std::vector<uint32_t>> own;     // per view: the cells whose pixels are evaluated there
  std::vector<std::array<int32_t, 2>> pairs;  // of view indices: reference, other
  int reference_margin_px = 0, target_margin_px = 0;
};

struct VisibleCells {
  std::vector<std::vector<uint32_t>> cells;  // per view: cells that a needed pixel may show, ascending
  std::vector<PixelRect> windows;            // per view: smallest rectangle with all needed pixels; may be empty
  // As the above, of step 1 alone: what derivatives of own cells read.
  std::vector<std::vector<uint32_t>> own_cells;
  std::vector<PixelRect> own_windows;
};

// A conservative bound, in three steps:
//   1. Derivatives of own cells in view i read pixels within reference_margin_px of the own cells' projections. These
//     pixels may show any cell whose box projects to them.
//   2. Such a cell is warped into a partner view j, where pixels within target_margin_px of its projection are read.
//   3. The nearest surface at these pixels of i and j is one of the cells whose boxes project to them.
// Occlusion is not tested, so the result holds however the vertices move inside their boxes.
VisibleCells FindVisibleCells(const VisibleCellsProblem& problem);

// VisibleCellsProblem::own: per view, the cells that contain a face with a flag in `own` and for which the view is
// selected. `selected`: ViewGroups::selected with one group per cell.
std::vector<std::vector<uint32_t>> OwnCellsOfViews(const MeshCells& cells, const std::vector<uint8_t>& own,
                                                   const std::vector<std::vector<uint8_t>>& selected, size_t views);

}  // namespace tessera
