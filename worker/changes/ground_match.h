// Photo-consistency of surface patches seen from above: windows of ground plane samples, lifted to a height each, are
// projected into every view and compared by normalised cross-correlation.
#pragma once

#include <span>
#include <vector>

#include "common/job/ground.h"
#include "worker/changes/change_view.h"

namespace tessera {

// Sample positions of a block: `samples_per_cell` per cell and axis, with a margin of cells on each side for the
// windows.
struct SampleGrid {
  CellRect cells;
  double cell_m = 1;
  int samples_per_cell = 3;
  int window_samples = 7;  // side of a window, centred on its cell

  int margin_cells() const;
  int width() const { return cells.x1 - cells.x0; }
  int height() const { return cells.y1 - cells.y0; }
  int columns() const { return (width() + 2 * margin_cells()) * samples_per_cell; }
  int rows() const { return (height() + 2 * margin_cells()) * samples_per_cell; }
  double spacing_m() const { return cell_m / samples_per_cell; }
  // Of sample column i or row j.
  double X_m(int i) const { return (cells.x0 - margin_cells()) * cell_m + (i + 0.5) * spacing_m(); }
  double Y_m(int j) const { return (cells.y0 - margin_cells()) * cell_m + (j + 0.5) * spacing_m(); }
};

// Owns the buffers for one block. Not thread-safe: one call at a time.
class GroundMatcher {
 public:
  // All arguments must outlive the object.
  GroundMatcher(const SampleGrid& grid, const GroundPlane& ground, std::span<const ChangeView> views,
                const ViewChoice& choice);

  // For each cell (row by row) the mean ZNCC of the best pairs on the horizontal plane at `height_m`, reduced if only
  // one or two pairs show the window; NaN if none does.
  void MatchPlane(double height_m, std::vector<float>* scores);
  // The same for one height per sample (rows() x columns(); NaN: none).
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
  // One array per view. Within a row, the first samples of all cells come first, then the second ones and so on, so
  // that adjacent floats belong to adjacent cells. Padded at the end for vector loads.
  std::vector<std::vector<float>> luminance_;
};

}  // namespace tessera
