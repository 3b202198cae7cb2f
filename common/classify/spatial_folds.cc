#include "common/classify/spatial_folds.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tessera {
namespace {

constexpr int kCellsPerFold = 6;
constexpr int kHalvings = 8;
constexpr int kImageCell_px = 128;  // cell of pixels that do not hit the mesh

}  // namespace

SpatialFolds::Cell SpatialFolds::CellOf(const PixelLocation& pixel) const {
  if (!pixel.ground_m) return {pixel.view + 1, pixel.x / kImageCell_px, pixel.y / kImageCell_px};
  return {0, static_cast<int64_t>(std::floor(pixel.ground_m->x() / cell_m_)),
          static_cast<int64_t>(std::floor(pixel.ground_m->y() / cell_m_))};
}

// Small cells give balanced folds but let neighbouring, similar pixels into different folds, so cells are only as small
// as the number of folds needs. Assigning the fullest cells first to the emptiest fold (greedy number partitioning)
// balances the folds; ties are broken by the cell's coordinates, so the result is deterministic.
SpatialFolds SpatialFolds::Of(const std::vector<PixelLocation>& pixels, int folds) {
  SpatialFolds result;
  Eigen::Vector2d low = Eigen::Vector2d::Constant(1e300), high = -low;
  for (const PixelLocation& pixel : pixels) {
    if (!pixel.ground_m) continue;
    low = low.cwiseMin(*pixel.ground_m);
    high = high.cwiseMax(*pixel.ground_m);
  }
  result.cell_m_ = std::max(1e-3, low.x() <= high.x() ? (high - low).maxCoeff() / 4 : 1.0);
  std::map<Cell, int64_t> counts;
  for (int halving = 0;; ++halving) {
    counts.clear();
    for (const PixelLocation& pixel : pixels) ++counts[result.CellOf(pixel)];
    if (static_cast<int>(counts.size()) >= kCellsPerFold * folds || halving == kHalvings) break;
    result.cell_m_ /= 2;
  }
  std::vector<std::pair<int64_t, Cell>> order;
  for (const auto& [cell, count] : counts) order.push_back({-count, cell});
  std::sort(order.begin(), order.end());
  std::vector<int64_t> filled(folds, 0);
  for (const auto& [negative, cell] : order) {
    const auto least = std::min_element(filled.begin(), filled.end());
    *least -= negative;
    result.fold_of_cell_[cell] = static_cast<int>(least - filled.begin());
  }
  result.folds_ = std::min<int>(folds, static_cast<int>(order.size()));
  return result;
}

int SpatialFolds::FoldOf(const PixelLocation& pixel) const {
  const auto it = fold_of_cell_.find(CellOf(pixel));
  return it == fold_of_cell_.end() ? -1 : it->second;
}

}  // namespace tessera
