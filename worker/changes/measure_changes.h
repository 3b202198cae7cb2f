// Measures new heights and labels per ground cell from a new flight's images, by a plane sweep against the old
// surface.
//
// In each block, horizontal planes are swept from below the old ground to well above the old roofs. At each height,
// windows of all near-nadir views are compared pairwise by ZNCC. Only the best pairs count, so that occlusion in some
// views does no harm. The agreement of the class likelihoods is added. Semi-global aggregation (Hirschmüller 2008)
// over the cells selects the heights. The old surface is an additional hypothesis, matched in its true shape and
// given a small bonus, so that noise does not change unchanged ground.
#pragma once

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
  double below_m = 6, above_m = 45;  // range of the sweep relative to the block's low ground
  double above_roofs_m = 10;         // minimum range above the block's highest old surface
  double step_px = 1.0;              // parallax between two heights in the widest pair
  double semantic_weight = 0.3;      // weight of the likelihoods' disagreement relative to the images'
  double old_bonus = 0.02;           // bonus of the old height, in units of agreement
  SmoothPenalties penalties;
  BlockViewOptions views;
};

// A raster made of whole blocks (kBlockCells) has the same bytes for every division of the city, if the views are
// given in the same order.

// Smallest rectangle of whole blocks that contains `cells`.
CellRect WholeBlocks(const CellRect& cells);

// Indices of the cameras whose pixels MeasureChanges reads, ascending.
std::vector<int> ViewsToMeasure(const MeshSpans& old_mesh, const GroundPlane& ground, const CellRect& cells,
                                const std::vector<PosedCamera>& cameras, double gsd_m, const MeasureOptions& options);

// Measures `cells`. `old_mesh`: the old surface in the local frame, covering `cells` and a margin, with or without
// labels. `ground`: its cell_m is the raster's (ChangeCellSize_m). `views`: of the new flight only. `classes`: planes
// of all likelihoods. Processes one block per thread, about 100 MB each; the result does not depend on the number of
// threads.
ChangeRaster MeasureChanges(const MeshSpans& old_mesh, const GroundPlane& ground, const CellRect& cells,
                            std::span<const ChangeView> views, int classes, double gsd_m,
                            const MeasureOptions& options);

}  // namespace tessera
