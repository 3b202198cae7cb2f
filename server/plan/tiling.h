// The grid of tiles over the cells of a survey.
#ifndef TESSERA_SERVER_PLAN_TILING_H_
#define TESSERA_SERVER_PLAN_TILING_H_

#include <vector>

#include "common/tile/ground.h"
#include "common/tile/survey.h"

namespace tessera {

struct TilingOptions {
  int tiles = 0;             // wanted number; 0: as many as the limits ask for
  double max_faces = 300e3;  // of a core, when tiles = 0
  double max_work = 8e6;     // of a core in faces times views, when tiles = 0
};

// Rectangles of cells that cover every cell of the survey exactly once, none without faces, by row and column. The rows
// are cut first, then every row into its own columns, at the borders of cells, so that the parts have like shares of
// the predicted work; the number of rows follows the city's aspect. Exactly `tiles` of them unless the city has too few
// rows and columns of cells, or gaps, for so many.
std::vector<CellRect> LayOutTiles(const Survey& survey, const TilingOptions& options);

// Predicted work of refining a tile with this core: faces times the views that see them, over core and halo.
double PredictWork(const Survey& survey, const CellRect& core, double halo_m);

}  // namespace tessera

#endif  // TESSERA_SERVER_PLAN_TILING_H_
