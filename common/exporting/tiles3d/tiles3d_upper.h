// Levels above the sheets.
#pragma once

#include <vector>

#include "common/exporting/tiles3d/tiles3d.h"
#include "common/exporting/tiles3d/tiles3d_border.h"
#include "common/exporting/tiles3d/tiles3d_part.h"
#include "common/exporting/tiles3d/tiles3d_simplify.h"

namespace tessera {

// How far a tile whose square has this side is simplified.
Tiles3dTarget Tiles3dTargetOf(const Tiles3dSizes& sizes, double side_m, bool photographic);

// One part of the parts of four tiles or fewer, as MergeTiles3d; its mesh is not yet simplified.
Tiles3dPart MergeTiles3dParts(std::vector<Tiles3dPart> children);

// Thins the border of the part's mesh and simplifies it, as a tile of level `level` (1: of two by two sheets).
// `borders`: Tiles3dSharedEdges of each other tile of the level that touches it, not thinned. `side_m`: of its square.
// Returns the geometric error of the tile, which is larger than `children_error_m`. Updates part->error_m.
double SimplifyTiles3dPart(const std::vector<std::vector<Tiles3dEdge>>& borders, double side_m, double children_error_m,
                           bool photographic, const Tiles3dSizes& sizes, Tiles3dPart* part);

}  // namespace tessera
