// Spatial cross-validation folds. Images overlap, so pixels of different images may show the same ground; they must be
// in the same fold, else a classifier would be tested on ground that it was trained on.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

namespace tessera {

// The location of a pixel: ground coordinates, or the position in its image if its ray does not hit the mesh.
struct PixelLocation {
  std::optional<Eigen::Vector2d> ground_m;
  uint32_t view = 0;
  int x = 0, y = 0;
};

// Assignment of square cells to folds: cells of the ground, and of images for pixels that do not hit the mesh.
class SpatialFolds {
 public:
  // Halves the cell size until there are at least six cells per fold (at most 8 times), then distributes the cells,
  // those with most pixels first, so that folds have about equally many pixels. `folds` is in [2, 16]. The order of the
  // pixels does not matter.
  static SpatialFolds Of(const std::vector<PixelLocation>& pixels, int folds);

  int folds() const { return folds_; }  // folds with pixels; fewer than requested if there are few cells
  double cell_m() const { return cell_m_; }
  // The fold of the pixel's cell; -1 if no pixel of Of() lay in that cell.
  int FoldOf(const PixelLocation& pixel) const;

 private:
  using Cell = std::array<int64_t, 3>;
  Cell CellOf(const PixelLocation& pixel) const;

  double cell_m_ = 1;
  int folds_ = 0;
  std::map<Cell, int> fold_of_cell_;
};

}  // namespace tessera
