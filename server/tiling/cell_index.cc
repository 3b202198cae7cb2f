#include "server/tiling/cell_index.h"

#include <algorithm>
#include <climits>
#include <numeric>
#include <tuple>

namespace tessera {

CellIndex::CellIndex(const Survey& survey) : survey_(survey), bounds_{INT_MAX, INT_MAX, INT_MIN, INT_MIN} {
  const std::vector<SurveyCell>& cells = survey.cells;
  if (cells.empty()) bounds_ = {};
  for (const SurveyCell& cell : cells) {
    bounds_ = {std::min(bounds_.x0, cell.x), std::min(bounds_.y0, cell.y), std::max(bounds_.x1, cell.x + 1),
               std::max(bounds_.y1, cell.y + 1)};
  }
  order_.resize(cells.size());
  std::iota(order_.begin(), order_.end(), 0u);
  std::sort(order_.begin(), order_.end(), [&](uint32_t a, uint32_t b) {
    return std::tie(cells[a].y, cells[a].x) < std::tie(cells[b].y, cells[b].x);
  });
  row_begin_.assign(bounds_.y1 - bounds_.y0 + 1, 0);
  for (const SurveyCell& cell : cells) ++row_begin_[cell.y - bounds_.y0 + 1];
  for (size_t row = 1; row < row_begin_.size(); ++row) row_begin_[row] += row_begin_[row - 1];
}

uint32_t CellIndex::FirstInRow(int y, int x) const {
  const auto begin = order_.begin() + row_begin_[y - bounds_.y0], end = order_.begin() + row_begin_[y - bounds_.y0 + 1];
  return static_cast<uint32_t>(
      std::lower_bound(begin, end, x, [&](uint32_t cell, int value) { return survey_.cells[cell].x < value; }) -
      order_.begin());
}

}  // namespace tessera
