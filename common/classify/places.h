// Which pixels show the same place, so that a classifier is tested where it has not learnt: images overlap, and a place
// that one annotated image teaches is no test in another.
#ifndef TESSERA_COMMON_CLASSIFY_PLACES_H_
#define TESSERA_COMMON_CLASSIFY_PLACES_H_

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

namespace tessera {

// Where a pixel looks: a place on the ground, or, where it sees no mesh, a place in its image.
struct PixelPlace {
  std::optional<Eigen::Vector2d> ground_m;
  uint32_t view = 0;
  int x = 0, y = 0;
};

// Square cells of the ground (and, without mesh, of images) and the fold of each. A plain value.
class PlaceFolds {
 public:
  // Cells are made so small that there are at least six for each of `folds`, or as small as they may be; folds get
  // cells with about equally many pixels, the fullest first. `folds` in [2, 16]. Pixels in any order.
  static PlaceFolds Of(const std::vector<PixelPlace>& pixels, int folds);

  int folds() const { return folds_; }  // that have pixels; fewer than asked for where places are few
  double cell_m() const { return cell_m_; }
  // -1 for a cell without any of the pixels.
  int FoldOf(const PixelPlace& pixel) const;

 private:
  using Cell = std::array<int64_t, 3>;
  Cell CellOf(const PixelPlace& pixel) const;

  double cell_m_ = 1;
  int folds_ = 0;
  std::map<Cell, int> fold_of_cell_;
};

}  // namespace tessera

#endif  // TESSERA_COMMON_CLASSIFY_PLACES_H_
