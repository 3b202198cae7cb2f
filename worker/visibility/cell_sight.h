// What the pixels of some cells of a mesh can depend on: which cells, and which part of each image.
#ifndef TESSERA_WORKER_VISIBILITY_CELL_SIGHT_H_
#define TESSERA_WORKER_VISIBILITY_CELL_SIGHT_H_

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

#include "worker/visibility/image_window.h"
#include "worker/visibility/mesh_cells.h"

namespace tessera {

struct CellSightProblem {
  std::vector<Eigen::AlignedBox3d> boxes;     // all that is in a cell, wherever it may be
  std::vector<CameraWindow> views;            // pixels beyond these are of no use
  std::vector<std::vector<uint32_t>> own;     // of each view: the cells whose pixels are wanted there
  std::vector<std::array<int32_t, 2>> pairs;  // of views: reference, other
  int reference_margin_px = 0, target_margin_px = 0;
};

struct CellSight {
  std::vector<std::vector<uint32_t>> cells;  // of each view those that a needed pixel may show, ascending
  std::vector<PixelRect> windows;            // of each view the smallest with all needed pixels; empty: none
  std::vector<PixelRect> own_windows;        // the same of step 1 alone: those that derivatives of own cells read
};

// The derivatives of own cells in view i read the pixels within reference_margin_px of those that show them. These may
// show any cell whose box projects to them (step 1), and land in a partner j within target_margin_px of where such a
// cell projects to (step 2). Which surface is nearest at these pixels of i and j is decided among the cells whose boxes
// project to them (step 3). No occlusion is asked, so what hides what may change as it likes.
CellSight FindCellSight(const CellSightProblem& problem);

// CellSightProblem::own: of each of `views` views the cells that have a face with a flag in `own` and that the view
// looks at (ViewGroups::looks of the cells).
std::vector<std::vector<uint32_t>> OwnCellsOfViews(const MeshCells& cells, const std::vector<uint8_t>& own,
                                                   const std::vector<std::vector<uint8_t>>& looks, size_t views);

}  // namespace tessera

#endif  // TESSERA_WORKER_VISIBILITY_CELL_SIGHT_H_
