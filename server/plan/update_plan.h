// What a new flight changes: which tiles of an earlier job are done anew, why, and what that takes.
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

// Why a tile is done anew.
enum class ChangeReason {
  kImageSeen,        // a cell of its core chose a view that the base does not have
  kImageSuperseded,  // a view of the base gave its place to others
  kImageWithdrawn,
  kImageChanged,  // other pixels or likelihoods under a camera of the base
  kPoseMoved,
  kMeshChanged,  // over a cell of its core
  kChosenAnew,   // a view of the base that the cell had not chosen before
};
std::string ReasonWords(ChangeReason reason);

struct TileChange {
  struct Why {
    ChangeReason reason;
    std::vector<int32_t> views;  // ascending
  };
  TileParameters tile;
  std::vector<Why> why;  // empty: the tile stays as it is
  // Of all tasks of the tile, where it is redone: seconds summed, memory of the hungriest.
  Prediction predicted;
};

// The base's tiles, grown where the survey has cells beyond them; a tile of its own for a cell that none can grow to
// without meeting another. A tile of which no cell is left is gone: it keeps its number, which is never given again,
// and has an empty core.
std::vector<TileParameters> TilesOfUpdate(std::vector<TileParameters> tiles, const Survey& survey);

// What an update does. `survey` took the base's on: the same ground cells unless the mesh changed, views under the same
// numbers, new ones behind them. A tile is redone if one of its cells has another mesh or chooses other views than in
// the base, or one of those that it chooses changed. `tiles`: TilesOfUpdate. INVALID_ARGUMENT if the surveys do not fit
// together.
StatusOr<std::vector<TileChange>> FindChangedTiles(const JobSettings& settings, const Survey& base,
                                                   const Survey& survey, const std::vector<TileParameters>& tiles,
                                                   const CostScale& costs);

// Of the task that took the base's survey on: what is new is read, and cells that it may show choose their views.
Prediction PredictUpdateIngest(const Survey& base, const Survey& survey);

// Of these views, those whose likelihoods the base has not made, where jobs make them.
std::set<int32_t> ViewsToClassify(const Survey& base, const Survey& survey, std::set<int32_t> read);

// The steps that tiles take which begin at a refined state: of the first round and the last labels and the two finest
// levels; all levels if the mesh changed. Indices in RefineStepsOf.
std::vector<int> UpdateSteps(const JobSettings& settings, const Survey& survey);

// kUpdateFile. Of `tiles_of_base` it names those that are gone. `full`: what a job on all images is predicted to take,
// and one from scratch at most: which tiles it redoes beside the changed ones shows as it goes ("redone": null).
std::string UpdatePlanJson(const std::string& base, bool from_scratch, size_t views_of_base,
                           const std::vector<TileParameters>& tiles_of_base, const std::vector<TileChange>& changes,
                           const Survey& survey, const Prediction& ingest, const Prediction& compare,
                           const Prediction& publish, const Quote& full);

}  // namespace tessera
