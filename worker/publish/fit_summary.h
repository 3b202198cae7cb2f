// How the images fit the result beside the start, over all tiles.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/survey.h"
#include "worker/publish/job_summary.h"
#include "worker/tile/tile_fit.h"

namespace tessera {

// The fit of one tile with its id.
struct FitOfTile {
  int tile = 0;
  TileFit fit;
};

// The fits in the reports of the tiles; none for a tile that moved no vertices.
std::vector<FitOfTile> FitsOf(const std::vector<ReportedTile>& tiles);

// JSON: patches, their shares above chance at the start and in the result, and the shares that became worse or better.
std::string FitShares(const FitChange& change);

// JSON, for report.json: FitShares of all tiles together, whether the result is worse as a whole (FitChange::IsWorse),
// and the tiles and images where it is. Names of images are those of `survey`.
std::string FitSummary(const std::vector<FitOfTile>& tiles, const Survey& survey);

// A warning if the result is worse as a whole, one about the tiles where it is, and one about the images.
Warnings FitWarnings(const std::vector<FitOfTile>& tiles, const Survey& survey);

}  // namespace tessera
