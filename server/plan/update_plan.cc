#include "server/plan/update_plan.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/str_format.h"
#include "common/job/refine_steps.h"
#include "common/job/task_kinds.h"
#include "server/tiling/cell_index.h"
#include "server/tiling/crop_groups.h"

namespace tessera {
namespace {

using nlohmann::json;

// Number of finest levels of an update. One level cannot remove demolished houses; all levels lose the base's accuracy
// in unchanged places.
constexpr size_t kUpdateLevels = 2;

// Changes of a view that a cell chose before and still chooses.
std::vector<ChangeReason> ChangesOf(const SceneView& before, const SceneView& now) {
  std::vector<ChangeReason> changes;
  if (!(before.camera == now.camera && before.lens == now.lens)) changes.push_back(ChangeReason::kPoseMoved);
  if (before.image_content != now.image_content || before.likelihood_content != now.likelihood_content) {
    changes.push_back(ChangeReason::kImageChanged);
  }
  return changes;
}

void FindReasons(const Survey& base, const Survey& survey, const SurveyCell& before, const SurveyCell& now,
                 std::map<ChangeReason, std::set<int32_t>>* why) {
  std::vector<int32_t> left, came, stayed;
  std::set_difference(before.views.begin(), before.views.end(), now.views.begin(), now.views.end(),
                      std::back_inserter(left));
  std::set_difference(now.views.begin(), now.views.end(), before.views.begin(), before.views.end(),
                      std::back_inserter(came));
  std::set_intersection(now.views.begin(), now.views.end(), before.views.begin(), before.views.end(),
                        std::back_inserter(stayed));
  for (const int32_t v : left) {
    (*why)[survey.views[v].withdrawn ? ChangeReason::kImageWithdrawn : ChangeReason::kImageSuperseded].insert(v);
  }
  const auto known = static_cast<int32_t>(base.views.size());
  for (const int32_t v : came) (*why)[v < known ? ChangeReason::kNewlyChosen : ChangeReason::kImageSeen].insert(v);
  for (const int32_t v : stayed) {
    for (const ChangeReason change : ChangesOf(base.views[v], survey.views[v])) (*why)[change].insert(v);
  }
}

// Cells of a survey by position. The survey must outlive it.
class CellsByPosition {
 public:
  explicit CellsByPosition(const Survey& survey) {
    for (const SurveyCell& cell : survey.cells) cells_[{cell.x, cell.y}] = &cell;
  }
  const SurveyCell* Find(const SurveyCell& cell) const {
    const auto found = cells_.find({cell.x, cell.y});
    return found == cells_.end() ? nullptr : found->second;
  }

 private:
  std::map<std::pair<int, int>, const SurveyCell*> cells_;
};

bool Overlap(const CellRect& a, const CellRect& b) { return a.x0 < b.x1 && b.x0 < a.x1 && a.y0 < b.y1 && b.y0 < a.y1; }

// In the order of ChangeReason.
constexpr const char* kReasonWords[] = {"image seen", "image superseded", "image withdrawn",   "image changed",
                                        "pose moved", "mesh changed",     "image newly chosen"};

json PredictionJson(const Prediction& prediction) {
  return {{"core_seconds", prediction.core_seconds},
          {"peak_bytes", prediction.peak_bytes},
          {"stored_bytes", prediction.stored_bytes}};
}

}  // namespace

std::vector<int> UpdateSteps(const JobSettings& settings, const Survey& survey) {
  const std::vector<RefineStep> steps = StepsOf(settings);
  std::vector<int> chosen = ActiveStepsOf(settings, survey);
  // Later rounds have the finest level only, so the first round is needed for the others.
  std::erase_if(chosen, [&](int s) { return steps[s].round != 0 && steps[s].round != steps.back().round; });
  if (survey.revision) return chosen;  // new faces have not been refined
  std::set<int> levels;
  for (const int s : chosen) {
    if (!steps[s].labels()) levels.insert(steps[s].level);
  }
  if (levels.size() > kUpdateLevels) levels.erase(std::next(levels.begin(), kUpdateLevels), levels.end());
  std::erase_if(chosen, [&](int s) { return !steps[s].labels() && !levels.contains(steps[s].level); });
  return chosen;
}

std::vector<TileParameters> TilesOfUpdate(std::vector<TileParameters> tiles, const Survey& survey) {
  return survey.revision ? GrownTiles(std::move(tiles), survey) : tiles;
}

std::vector<TileParameters> GrownTiles(std::vector<TileParameters> tiles, const Survey& survey) {
  const CellIndex index(survey);
  std::set<const SurveyCell*> in_tiles;
  for (TileParameters& tile : tiles) {
    const size_t before = in_tiles.size();
    index.ForEachIn(tile.core, [&](const SurveyCell& cell) { in_tiles.insert(&cell); });
    if (in_tiles.size() == before) tile.core = {};
  }
  for (const SurveyCell& cell : survey.cells) {
    if (in_tiles.contains(&cell)) continue;
    const auto has = [&](const TileParameters& tile) { return tile.core.Contains({cell.x, cell.y}); };
    if (std::any_of(tiles.begin(), tiles.end(), has)) continue;
    // Grow the tile that needs the fewest additional cells.
    TileParameters* best = nullptr;
    CellRect grown;
    int64_t least = 0;
    for (TileParameters& tile : tiles) {
      const CellRect& core = tile.core;
      if (core.empty()) continue;
      const CellRect with = {std::min(core.x0, cell.x), std::min(core.y0, cell.y), std::max(core.x1, cell.x + 1),
                             std::max(core.y1, cell.y + 1)};
      const auto cells = [](const CellRect& rect) { return int64_t{rect.x1 - rect.x0} * (rect.y1 - rect.y0); };
      const int64_t more = cells(with) - cells(core);
      if (best != nullptr && more >= least) continue;
      const bool meets = std::any_of(tiles.begin(), tiles.end(), [&](const TileParameters& other) {
        return other.tile != tile.tile && !other.core.empty() && Overlap(with, other.core);
      });
      if (meets) continue;
      best = &tile;
      grown = with;
      least = more;
    }
    if (best != nullptr) {
      best->core = grown;
    } else {
      tiles.push_back({static_cast<int>(tiles.size()), {cell.x, cell.y, cell.x + 1, cell.y + 1}});
    }
  }
  return tiles;
}

Prediction PredictUpdateIngest(const Survey& base, const Survey& survey) {
  Survey part;
  part.has_likelihoods = survey.has_likelihoods;
  part.classifier = survey.classifier;
  part.classes = survey.classes;
  for (size_t v = 0; v < survey.views.size(); ++v) {
    if (v >= base.views.size() || survey.views[v].image_content != base.views[v].image_content) {
      part.views.push_back(survey.views[v]);
    }
  }
  const CellsByPosition before(base);
  for (const SurveyCell& cell : survey.cells) {
    const SurveyCell* known = before.Find(cell);
    if (known != nullptr && known->views == cell.views && !IsRevised(survey, cell.x, cell.y)) continue;
    part.cells.push_back(cell);
    part.faces += cell.faces;
  }
  if (survey.revision) part.faces = base.faces + survey.faces;  // both meshes are read
  Prediction prediction = PredictIngest(part);
  prediction.stored_bytes = PredictIngest(survey).stored_bytes;  // upper bound: the mesh is stored only if it changed
  return prediction;
}

std::set<int32_t> ViewsToClassify(const Survey& base, const Survey& survey, std::set<int32_t> read) {
  if (survey.revision) return read;
  std::erase_if(read, [&](int32_t v) {
    if (static_cast<size_t>(v) >= base.views.size()) return false;
    const SceneView &before = base.views[v], &now = survey.views[v];
    return before.likelihood_content == now.likelihood_content && before.camera == now.camera &&
           before.lens == now.lens;
  });
  return read;
}

StatusOr<std::vector<TileChange>> FindChangedTiles(const JobSettings& settings, const Survey& base,
                                                   const Survey& survey, const std::vector<TileParameters>& tiles,
                                                   const CostScale& costs) {
  if (survey.views.size() < base.views.size()) {
    return absl::InvalidArgumentError("update: found fewer views in the survey than in that of the base job");
  }
  const CellsByPosition before(base), after(survey);
  const auto all_in = [&](const std::vector<SurveyCell>& cells, const CellsByPosition& others) {
    return std::all_of(cells.begin(), cells.end(), [&](const SurveyCell& cell) {
      return others.Find(cell) != nullptr || IsRevised(survey, cell.x, cell.y);
    });
  };
  if (!all_in(survey.cells, before) || !all_in(base.cells, after)) {
    return absl::InvalidArgumentError("update: found other cells in the survey than in that of the base job");
  }
  const bool from_scratch = settings.update.from_scratch;
  RefineEffort effort = EffortOf(
      StepsOf(settings), from_scratch ? ActiveStepsOf(settings, survey) : UpdateSteps(settings, survey));
  if (from_scratch) effort.mends += 1;  // repair of the start
  const CellIndex cells(survey);
  std::vector<TileChange> changes;
  std::map<int, TileWork> works;
  std::vector<CroppedTile> cropped;
  for (const TileParameters& tile : tiles) {
    TileChange& change = changes.emplace_back();
    change.tile = tile;
    std::map<ChangeReason, std::set<int32_t>> why;
    for (const SurveyCell& cell : survey.cells) {
      if (!tile.core.Contains({cell.x, cell.y})) continue;
      if (const SurveyCell* known = before.Find(cell)) FindReasons(base, survey, *known, cell, &why);
    }
    if (survey.revision) {
      for (const auto& [x, y] : survey.revision->cells) {
        if (tile.core.Contains({x, y})) why[ChangeReason::kMeshChanged];
      }
    }
    for (const auto& [reason, views] : why) change.why.push_back({reason, {views.begin(), views.end()}});
    if (change.why.empty()) continue;
    const TileWork& work = works.emplace(tile.tile, MeasureTile(cells, tile.core)).first->second;
    cropped.push_back({tile.tile, &work});
    for (const Prediction& part : {costs.Corrected(kCutKind, PredictCut(survey, work)),
                                   costs.Corrected(kMeasureKind, PredictMeasure(work, effort)),
                                   costs.Corrected(kSolveKind, PredictSolve(work, effort)),
                                   costs.Corrected(kMendKind, PredictMend(work, effort))}) {
      change.predicted += part;
    }
  }
  for (const CropGroup& group : CropGroupsOf(survey, cropped, MaxCropGroupPeak_bytes(settings))) {
    for (TileChange& change : changes) {
      if (!std::binary_search(group.tiles.begin(), group.tiles.end(), change.tile.tile)) continue;
      change.predicted += costs.Corrected(kCropKind, ShareOfCrop(group, /*has_fine_part=*/false));
    }
  }
  return changes;
}

std::string UpdatePlanJson(const std::string& base, bool from_scratch, size_t views_of_base,
                           const std::vector<TileParameters>& tiles_of_base, const std::vector<TileChange>& changes,
                           const Survey& survey, const Prediction& ingest, const Prediction& compare,
                           const Prediction& publish, const Quote& full) {
  double core_seconds = from_scratch ? full.core_seconds  // upper bound
                                     : ingest.core_seconds + compare.core_seconds + publish.core_seconds;
  int64_t stored_bytes =
      from_scratch ? full.stored_bytes : ingest.stored_bytes + compare.stored_bytes + publish.stored_bytes;
  int redone = 0;
  json tiles = json::array(), gone = json::array();
  for (const TileChange& change : changes) {
    if (change.tile.core.empty()) {
      if (!tiles_of_base[change.tile.tile].core.empty()) gone.push_back(change.tile.tile);
      continue;
    }
    json why = json::array();
    for (const TileChange::Why& each : change.why) {
      json images = json::array();
      for (const int32_t view : each.views) images.push_back(survey.views[view].name);
      why.push_back({{"reason", kReasonWords[static_cast<int>(each.reason)]}, {"images", std::move(images)}});
    }
    const CellRect& core = change.tile.core;
    tiles.push_back({{"tile", change.tile.tile},
                     {"core", {core.x0, core.y0, core.x1, core.y1}},
                     {"redone", from_scratch && change.why.empty() ? json(nullptr) : json(!change.why.empty())},
                     {"why", std::move(why)}});
    if (change.why.empty()) continue;
    tiles.back()["predicted"] = PredictionJson(change.predicted);
    if (!from_scratch) {
      core_seconds += change.predicted.core_seconds;
      stored_bytes += change.predicted.stored_bytes;
    }
    ++redone;
  }
  json cameras = json::array();
  for (size_t v = 0; v < survey.views.size(); ++v) {
    const SceneView& view = survey.views[v];
    const Eigen::Vector2d at = survey.ground.Coordinates(view.camera.Centre());
    cameras.push_back({{"at", {at.x(), at.y()}},
                       {"name", view.name},
                       {"state", view.withdrawn       ? "withdrawn"
                                 : v >= views_of_base ? "new"
                                                      : "known"}});
  }
  return json{{"tessera_update", 1},
              {"cameras", std::move(cameras)},
              {"base", base},
              {"from_scratch", from_scratch},
              {"tiles", std::move(tiles)},
              {"tiles_redone", redone},
              {"tiles_gone", gone},
              {"cell_m", survey.ground.cell_m},
              {"predicted",
               {{"core_seconds", core_seconds},
                {"core_seconds_in_full", full.core_seconds},
                {"stored_bytes", stored_bytes},
                {"stored_bytes_in_full", full.stored_bytes},
                {"ingest", PredictionJson(ingest)},
                {"changes", PredictionJson(compare)},
                {"publish", PredictionJson(publish)}}},
              {"warnings", survey.warnings}}
             .dump(1) +
         "\n";
}

}  // namespace tessera
