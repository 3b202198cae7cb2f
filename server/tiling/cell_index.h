// Spatial index of the cells of a survey.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "common/job/ground.h"
#include "common/job/survey.h"

namespace tessera {

// The survey must outlive the index and must not change. Thread-safe.
class CellIndex {
 public:
  explicit CellIndex(const Survey& survey);

  const Survey& survey() const { return survey_; }
  // Bounding rectangle of all cells.
  const CellRect& bounds() const { return bounds_; }

  // Calls visit(cell) for each cell in the rectangle, by y, then x.
  template <class Visit>
  void ForEachIn(const CellRect& rect, const Visit& visit) const {
    const int y0 = std::max(rect.y0, bounds_.y0), y1 = std::min(rect.y1, bounds_.y1);
    for (int y = y0; y < y1; ++y) {
      for (uint32_t i = FirstInRow(y, rect.x0); i < row_begin_[y - bounds_.y0 + 1]; ++i) {
        const SurveyCell& cell = survey_.cells[order_[i]];
        if (cell.x >= rect.x1) break;
        visit(cell);
      }
    }
  }

  // Calls visit(cell) for each cell at most `margin_m` from `core`, including those in it.
  template <class Visit>
  void ForEachWithin(const CellRect& core, double margin_m, const Visit& visit) const {
    const double cell_m = survey_.ground.cell_m;
    const int reach = 1 + static_cast<int>(std::floor(margin_m / cell_m));
    ForEachIn({core.x0 - reach, core.y0 - reach, core.x1 + reach, core.y1 + reach}, [&](const SurveyCell& cell) {
      if (DistanceBetween({cell.x, cell.y, cell.x + 1, cell.y + 1}, core, cell_m) <= margin_m) visit(cell);
    });
  }

 private:
  uint32_t FirstInRow(int y, int x) const;

  const Survey& survey_;
  CellRect bounds_;
  std::vector<uint32_t> order_;      // indices of cells, sorted by y, then x
  std::vector<uint32_t> row_begin_;  // begin of each row in order_, and the end
};

}  // namespace tessera
