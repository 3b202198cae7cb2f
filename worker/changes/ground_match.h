// How well views agree on pieces of a surface seen from above: windows of the ground plane's samples, lifted to a
// height each, looked up in every view and compared by normalised cross-correlation.
#ifndef TESSERA_WORKER_CHANGES_GROUND_MATCH_H_
#define TESSERA_WORKER_CHANGES_GROUND_MATCH_H_

#include <array>
#include <span>
#include <vector>

#include "common/job/ground.h"
#include "worker/changes/change_view.h"

namespace tessera {

// Samples of a block: `samples_per_cell` a cell and axis, and `rim` cells more on each side for the windows' sake.
struct SampleGrid {
  CellRect cells;
  double cell_m = 1;
  int samples_per_cell = 3;
  int window_samples = 7;  // side of a window, about the middle of its cell

  int rim() const;
  int width() const { return cells.x1 - cells.x0; }
  int height() const { return cells.y1 - cells.y0; }
  int columns() const { return (width() + 2 * rim()) * samples_per_cell; }
  int rows() const { return (height() + 2 * rim()) * samples_per_cell; }
  double spacing_m() const { return cell_m / samples_per_cell; }
  // Of sample column i or row j.
  double X_m(int i) const { return (cells.x0 - rim()) * cell_m + (i + 0.5) * spacing_m(); }
  double Y_m(int j) const { return (cells.y0 - rim()) * cell_m + (j + 0.5) * spacing_m(); }
};

// Keeps buffers for one block. One call at a time.
class GroundMatcher {
 public:
  // All must outlive it.
  GroundMatcher(const SampleGrid& grid, const GroundPlane& ground, std::span<const ChangeView> views,
                const ViewChoice& choice);

  // Of each cell (row by row) the mean ZNCC of the best few pairs for the horizontal plane at `height_m`, less where
  // only one or two pairs show the window; NaN where none does.
  void MatchPlane(double height_m, std::vector<float>* scores);
  // The same for heights a sample (rows() x columns(); NaN: none).
  void MatchSurface(std::span<const float> heights_m, std::vector<float>* scores);

 private:
  template <class Height>
  void Sample(const Height& height);
  void Correlate(std::vector<float>* scores);
  int FirstOfWindow() const;
  template <class Term>
  void SumWindows(int first_row, int first_cell, const Term& term) const;

  const SampleGrid& grid_;
  const GroundPlane& ground_;
  std::span<const ChangeView> views_;
  const ViewChoice& choice_;
  // A view's samples: row by row, within a row the first samples of all cells, then the second, ..., so that
  // neighbours in memory belong to neighbouring cells. A few more at the end, which nothing is made of.
  std::vector<std::vector<float>> luminance_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_CHANGES_GROUND_MATCH_H_
