// Plan of an update: which tiles of the base job are refined again, why, and at what cost. Functions are pure.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "server/settings/job_settings.h"
#include "server/tiling/cost_scale.h"
#include "server/tiling/quote.h"

namespace tessera {

// Why a tile is refined again.
enum class ChangeReason {
  kImageSeen,        // a cell of its core chose a view that the base does not have
  kImageSuperseded,  // a cell no longer chooses a view of the base
  kImageWithdrawn,
  kImageChanged,  // pixels or likelihoods of a view changed
  kPoseMoved,     // pose or calibration of a view changed
  kMeshChanged,   // in a cell of its core
  kNewlyChosen,   // a cell chose a view of the base that it had not chosen before
};

struct TileChange {
  struct Why {
    ChangeReason reason;
    std::vector<int32_t> views;  // ascending
  };
  TileParameters tile;
  std::vector<Why> why;  // empty: the tile is kept
  // Of all tasks of a redone tile: sums, but the largest memory.
  Prediction predicted;
};

// The tiles of a base or of the coarse part, grown to contain the survey's new cells. A cell that no tile can contain
// without overlapping another becomes a new tile. A tile without cells is removed: it gets an empty core, and its number
// is not reused.
std::vector<TileParameters> GrownTiles(std::vector<TileParameters> tiles, const Survey& survey);
// GrownTiles if the mesh changed, else `tiles`.
std::vector<TileParameters> TilesOfUpdate(std::vector<TileParameters> tiles, const Survey& survey);

// The changes of each tile. A tile is redone if, in one of its cells, the mesh, the selected views or one of those
// views changed. `survey`: the updated survey of `base`; it has the same cells unless the mesh changed, and the base's
// views come first. `tiles`: TilesOfUpdate. INVALID_ARGUMENT if the surveys do not match.
StatusOr<std::vector<TileChange>> FindChangedTiles(const JobSettings& settings, const Survey& base,
                                                   const Survey& survey, const std::vector<TileParameters>& tiles,
                                                   const CostScale& costs);

// Cost of the task that updates the survey: it reads new files and selects the views of the affected cells.
Prediction PredictUpdateIngest(const Survey& base, const Survey& survey);

// Views of `read` to classify: those whose likelihoods the base has not computed.
std::set<int32_t> ViewsToClassify(const Survey& base, const Survey& survey, std::set<int32_t> read);

// Steps of tiles that start from the base's states: in the first and the last round, the label steps and the two finest
// levels, or all levels if the mesh changed. Indices in RefineStepsOf.
std::vector<int> UpdateSteps(const JobSettings& settings, const Survey& survey);

// Content of kUpdateFile. `tiles_of_base`: to list removed tiles. `full`: cost of a job on all images, and upper bound
// of an update from scratch, whose redone tiles are not known beforehand ("redone": null).
std::string UpdatePlanJson(const std::string& base, bool from_scratch, size_t views_of_base,
                           const std::vector<TileParameters>& tiles_of_base, const std::vector<TileChange>& changes,
                           const Survey& survey, const Prediction& ingest, const Prediction& compare,
                           const Prediction& publish, const Quote& full);

}  // namespace tessera
