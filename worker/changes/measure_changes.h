// What a new flight's images say about the ground, cell by cell, against the old surface: new heights by a plane sweep.
//
// In each block of the plane, horizontal planes are swept from below the old ground to well above the old roofs. At
// each height windows of all near-nadir views are compared pair by pair (ZNCC; the pairs that agree best count, so that
// what some views do not see does no harm), with the agreement of the views' class likelihoods beside it. Semi-global
// aggregation (Hirschmüller 2008) over the cells gives the heights. The old surface is one more hypothesis, compared in
// its true shape and favoured slightly, so that unchanged ground is not found to move by noise.
#ifndef TESSERA_WORKER_CHANGES_MEASURE_CHANGES_H_
#define TESSERA_WORKER_CHANGES_MEASURE_CHANGES_H_

#include <span>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/job/change_cells.h"
#include "common/job/ground.h"
#include "worker/changes/change_raster.h"
#include "worker/changes/change_view.h"
#include "worker/changes/semi_global.h"

namespace tessera {

struct MeasureOptions {
  double below_m = 6, above_m = 45;  // of the sweep, from the block's low ground
  double above_roofs_m = 10;         // at least, over the block's highest old surface
  double step_px = 1.0;              // parallax of two heights in the widest pair
  double semantic_weight = 0.3;      // of the likelihoods' disagreement beside the images'
  double old_bonus = 0.02;           // of agreement that the old height is given
  SmoothPenalties penalties;
  BlockViewOptions views;
};

// Rasters of rectangles made of whole blocks (kBlockCells) have the same bytes however a city is cut, if the views come
// in the same order.

// The smallest rectangle of whole blocks that holds `cells`.
CellRect WholeBlocks(const CellRect& cells);

// Indices of the cameras that MeasureChanges would read pixels of, ascending.
std::vector<int> ViewsToMeasure(const MeshSpans& old_mesh, const GroundPlane& ground, const CellRect& cells,
                                const std::vector<PosedCamera>& cameras, double gsd_m, const MeasureOptions& options);

// `old_mesh`: the surface before in the local frame, `cells` and a margin around them, with labels or without.
// `ground`: its cell_m is the raster's (ChangeCellSize_m); `views`: of the new flight alone. `classes`: planes of all
// likelihoods. Uses the process's threads, a block each, and about 100 MB for each of them; the result does not depend
// on their number.
ChangeRaster MeasureChanges(const MeshSpans& old_mesh, const GroundPlane& ground, const CellRect& cells,
                            std::span<const ChangeView> views, int classes, double gsd_m,
                            const MeasureOptions& options);

}  // namespace tessera

#endif  // TESSERA_WORKER_CHANGES_MEASURE_CHANGES_H_
