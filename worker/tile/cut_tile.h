// Taking a tile out of the city.
#ifndef TESSERA_WORKER_TILE_CUT_TILE_H_
#define TESSERA_WORKER_TILE_CUT_TILE_H_

#include "common/base/status.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "worker/city/city_file.h"
#include "worker/tile/regions.h"
#include "worker/tile/sight.h"
#include "worker/tile/tile_files.h"
#include "worker/tile/tile_options.h"

namespace tessera {

struct CutOptions {
  SightOptions sight;
  RegionReach reach;
};

// As the operators' bounds have it for windows of this size and this coarsest level of the pyramid.
CutOptions CutOptionsOf(int window_px, int coarsest_level, double gsd_m, const TileRefineOptions& options);

struct CutResult {
  TilePackage package;
  TileReads reads;
};

// The cells of the core, all that its pixels may show, and all that the operators read about it, in whole cells; and
// whose states and sums the tile's tasks read, by the tiles' cores. Reads the blocks of the city that these lie in or
// touch, and no others. INVALID_ARGUMENT for a core without faces; errors as CityReader::Block's.
StatusOr<CutResult> CutTile(const CityReader& city, const Survey& survey, const CutParameters& parameters,
                            const CutOptions& options);

}  // namespace tessera

#endif  // TESSERA_WORKER_TILE_CUT_TILE_H_
