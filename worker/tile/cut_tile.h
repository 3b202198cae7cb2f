// Cuts a tile's package out of the city.
#pragma once

#include "common/base/status.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "worker/city/city_file.h"
#include "worker/city/moved_city.h"
#include "worker/tile/methods.h"
#include "worker/tile/regions.h"
#include "worker/tile/tile_files.h"
#include "worker/tile/visible_set.h"

namespace tessera {

struct CutOptions {
  double motion_m = 0;  // bound of a vertex's distance from the start
  VisibleSetOptions visible_set;
  RegionDependencyRadius radius;
};

// Margins, alignment and radii for the parameters' window size and levels. VisibleSetOptions::motion_m and
// RegionDependencyRadius::contact_m hold for the start, or in the fine part of a job for the surface with which it
// begins.
CutOptions CutOptionsOf(const CutParameters& parameters, double gsd_m, const TileRefineOptions& options);

struct CutResult {
  TilePackage package;
  TileReads reads;
};

// Builds the package: the core's cells, all cells that its pixels may show, and all cells that the operators read
// around it; also the tiles whose states and sums the tile's tasks read, by the tiles' cores. Reads only blocks of
// the city that contain or touch these cells. `moved`: the surface for which VisibleSetOptions::motion_m and
// RegionDependencyRadius::contact_m hold, at most CutOptions::motion_m from the start; null: the start.
// INVALID_ARGUMENT for a core without faces; DATA_LOSS if `moved` lacks a vertex; errors as CityReader::Block.
StatusOr<CutResult> CutTile(const CityReader& city, const Survey& survey, const CutParameters& parameters,
                            const CutOptions& options, const MovedSpans* moved = nullptr);

}  // namespace tessera
