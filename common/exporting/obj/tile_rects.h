// Which tile of a source owns a place in plan.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/scene/scene.h"

namespace tessera {

// Divides the plane among the tiles of a source: lines x = c and y = c make cells, and every cell has one owner.
// Immutable.
class TileRects {
 public:
  // One tile that owns everything.
  TileRects() = default;
  // `rects`: bounding rectangles of the tiles' meshes; those that are empty own nothing, unless all are empty: then the
  // first tile owns everything.
  //
  // Edges of two tiles that lie within a hundredth of the median side of a tile of each other become one line. If the
  // lines at which tiles meet make a grid with at most one tile a cell, each tile owns its cell. Otherwise all edges
  // are lines, and the first tile whose rectangle has a cell owns it. Cells without a tile go to the nearest one, so
  // that tiles at the rim extend to infinity.
  static TileRects Of(std::span<const PlanRect> rects);

  // The lines, ascending. Column k of the cells lies between xs[k - 1] and xs[k], rows in the same way. A point on a
  // line is in the cell above it.
  const std::vector<double>& xs() const { return xs_; }
  const std::vector<double>& ys() const { return ys_; }
  int32_t OwnerOf(size_t column, size_t row) const { return owners_[row * (xs_.size() + 1) + column]; }
  int32_t TileAt(const Eigen::Vector2d& point) const;
  // Points that are nearer to a line count as on the line: 1e-9 of the median side of a tile.
  double snap() const { return snap_; }

 private:
  bool MakeGrid(std::span<const PlanRect> rects, double tolerance);
  void MakeCells(std::span<const PlanRect> rects, double tolerance);
  void GiveToNearest(std::span<const PlanRect> rects);
  void RemoveIdleLines();

  std::vector<double> xs_, ys_;
  std::vector<int32_t> owners_ = {0};  // row by row; while they are made, -1: none
  double snap_ = 0;
};

}  // namespace tessera
