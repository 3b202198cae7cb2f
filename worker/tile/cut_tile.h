// Cuts a tile's package out of the city.
#pragma once

#include "common/base/status.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "worker/city/city_file.h"
#include "worker/tile/methods.h"
#include "worker/tile/regions.h"
#include "worker/tile/tile_files.h"
#include "worker/tile/visible_set.h"

namespace tessera {

struct CutOptions {
  VisibleSetOptions visible_set;
  RegionDependencyRadius radius;
};

// Margins and alignment for this window size and coarsest pyramid level.
CutOptions CutOptionsOf(int window_px, int coarsest_level, double gsd_m, const TileRefineOptions& options);

struct CutResult {
  TilePackage package;
  TileReads reads;
};

// Builds the package: the core's cells, all cells that its pixels may show, and all cells that the operators read
// around it; also the tiles whose states and sums the tile's tasks read, by the tiles' cores. Reads only blocks of
// the city that contain or touch these cells. INVALID_ARGUMENT for a core without faces; errors as CityReader::Block.
StatusOr<CutResult> CutTile(const CityReader& city, const Survey& survey, const CutParameters& parameters,
                            const CutOptions& options);

}  // namespace tessera
