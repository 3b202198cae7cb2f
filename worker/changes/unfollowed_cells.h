// Which cells the refined mesh shows as they were before.
#ifndef TESSERA_WORKER_CHANGES_UNFOLLOWED_CELLS_H_
#define TESSERA_WORKER_CHANGES_UNFOLLOWED_CELLS_H_

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/job/ground.h"
#include "worker/changes/change_areas.h"

namespace tessera {

// Of the areas that the refined mesh does not follow. Const functions may be called from any thread. Memory: 4 bytes a
// cell of the rectangle.
class UnfollowedCells {
 public:
  // `cells`: a rectangle that holds all areas' cells.
  UnfollowedCells(const CellRect& cells, const std::vector<ChangeArea>& areas);

  // Index of the area that has the cell or, so that walls on an area's border are in, one beside it; -1: none, as
  // outside of the rectangle.
  int AreaOf(const Eigen::Vector2i& cell) const;
  // Whether there are such cells in `part`.
  bool AnyIn(const CellRect& part) const;

 private:
  size_t Index(const Eigen::Vector2i& cell) const;

  CellRect cells_;
  std::vector<int32_t> area_;  // row by row
};

}  // namespace tessera

#endif  // TESSERA_WORKER_CHANGES_UNFOLLOWED_CELLS_H_
