// Cells of changed areas that the refined mesh does not follow.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/job/ground.h"
#include "worker/changes/change_areas.h"

namespace tessera {

// Lookup of such areas by cell. Const functions are thread-safe. Memory: 4 bytes per cell of the rectangle.
class UnfollowedCells {
 public:
  // `cells`: a rectangle that contains all areas' cells.
  UnfollowedCells(const CellRect& cells, const std::vector<ChangeArea>& areas);

  // Index of the area that contains the cell, or of one next to it, so that walls on an area's border are included.
  // -1: none, or outside the rectangle.
  int AreaOf(const Eigen::Vector2i& cell) const;
  // Whether `part` contains such a cell.
  bool AnyIn(const CellRect& part) const;

 private:
  size_t Index(const Eigen::Vector2i& cell) const;

  CellRect cells_;
  std::vector<int32_t> area_;  // row by row
};

}  // namespace tessera
