#include "server/tiling/quote.h"

#include <algorithm>
#include <functional>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/job/task_kinds.h"
#include "server/tiling/crop_groups.h"
#include "server/tiling/export_cost.h"
#include "server/tiling/tiling.h"

namespace tessera {
namespace {

double Makespan(std::vector<double> seconds, int workers) {
  std::sort(seconds.begin(), seconds.end(), std::greater<>());
  std::vector<double> busy_until(std::max(1, workers), 0.0);  // a heap with the earliest on top
  for (const double s : seconds) {
    std::pop_heap(busy_until.begin(), busy_until.end(), std::greater<>());
    busy_until.back() += s;
    std::push_heap(busy_until.begin(), busy_until.end(), std::greater<>());
  }
  return *std::max_element(busy_until.begin(), busy_until.end());
}

}  // namespace

Prediction TileQuote::Total() const {
  Prediction sum;
  for (const Prediction& part : {cut, crop, measure, solve, mend, refine}) sum += part;
  return sum;
}

Prediction PredictViews(const Survey& survey, const std::set<int32_t>& views, const CostScale& costs) {
  Prediction sum;
  if (survey.classifier.empty()) return sum;
  const std::vector<Prediction> predicted = PredictClassify(survey);
  for (const int32_t v : views) sum += costs.Corrected(kClassifyKind, predicted[v]);
  return sum;
}

StatusOr<Quote> MakeQuote(const JobSettings& settings, const Survey& survey, const CostScale& costs) {
  TESSERA_RETURN_IF_ERROR(CheckJobSettings(settings));
  Quote quote;
  const TilingOptions options = TilingOptionsOf(settings, survey);
  const JobEffort& effort = options.effort;
  const Survey last = AfterSecondSplit(survey, effort);
  const CellIndex cells(last);
  TESSERA_ASSIGN_OR_RETURN(const std::vector<CellRect> cores, LayOutTiles(cells, options));
  quote.ingest = costs.Corrected(kIngestKind, PredictIngest(survey));
  quote.publish = costs.Corrected(kPublishKind, PredictPublish(last));
  if (effort.has_parts()) {
    quote.split = costs.Corrected(
        kSplitKind, PredictSplit(static_cast<double>(survey.faces), static_cast<double>(last.faces)));
  }
  quote.interval = kRefineSecondsInterval;
  quote.area_m2 = static_cast<double>(survey.cells.size()) * survey.ground.cell_m * survey.ground.cell_m;
  quote += quote.ingest;
  quote += quote.publish;
  quote += quote.split;
  for (const CellRect& core : cores) {
    TileQuote tile;
    tile.tile = static_cast<int>(quote.tiles.size());
    tile.core = core;
    tile.work = MeasureTile(cells, core);
    tile.cut = costs.Corrected(kCutKind, PredictCut(last, tile.work));
    if (effort.has_parts()) {
      const TileWork coarse = WithFaces(tile.work, effort.coarse_faces);
      tile.cut += costs.Corrected(kCutKind, PredictCut(survey, coarse));
      tile.cut += costs.Corrected(kStartKind, PredictStart(last, tile.work));
    }
    if (cores.size() == 1) {
      tile.refine = costs.Corrected(kRefineKind, OfParts(PredictRefine, tile.work, effort));
    } else {
      tile.measure = costs.Corrected(kMeasureKind, OfParts(PredictMeasure, tile.work, effort));
      tile.solve = costs.Corrected(kSolveKind, OfParts(PredictSolve, tile.work, effort));
      tile.mend = costs.Corrected(kMendKind, OfParts(PredictMend, tile.work, effort));
    }
    quote.core_faces += tile.work.core_faces;
    quote.visible_faces += tile.work.visible_faces;
    quote.tiles.push_back(std::move(tile));
  }
  std::vector<CroppedTile> cropped;
  for (const TileQuote& tile : quote.tiles) cropped.push_back({tile.tile, &tile.work});
  for (const CropGroup& group : CropGroupsOf(last, cropped, MaxCropGroupPeak_bytes(settings))) {
    for (const int tile : group.tiles) {
      quote.tiles[tile].crop = costs.Corrected(kCropKind, ShareOfCrop(group, effort.has_parts()));
      quote.tiles[tile].crop_group = group.tiles.front();
    }
  }
  for (const TileQuote& tile : quote.tiles) quote += tile.Total();
  std::set<int32_t> views;
  for (const TileQuote& tile : quote.tiles) views.insert(tile.work.views.begin(), tile.work.views.end());
  quote.classify = PredictViews(survey, views, costs);
  quote += quote.classify;
  TESSERA_ASSIGN_OR_RETURN(const Prediction exports, PredictExports(settings, last));
  quote.exports = costs.Corrected(kExportKind, exports);
  quote += quote.exports;
  return quote;
}

double WallSeconds(const Quote& quote, int workers, int threads) {
  // Tasks of these kinds are many and similar, so they need no list scheduling.
  const double many = quote.classify.core_seconds + quote.exports.core_seconds;
  double seconds =
      quote.ingest.core_seconds + quote.split.core_seconds + quote.publish.core_seconds + many / std::max(1, workers);
  for (const Prediction TileQuote::*stage : {&TileQuote::cut, &TileQuote::crop, &TileQuote::measure, &TileQuote::solve,
                                             &TileQuote::mend, &TileQuote::refine}) {
    std::vector<double> tasks(quote.tiles.size());
    for (size_t t = 0; t < tasks.size(); ++t) {
      const size_t task = stage == &TileQuote::crop ? quote.tiles[t].crop_group : t;
      tasks[task] += (quote.tiles[t].*stage).core_seconds;
    }
    seconds += Makespan(std::move(tasks), workers);
  }
  return seconds / std::max(1, threads);
}

Status CheckPairs(const JobSettings& settings, const Survey& survey) {
  if (!survey.pairs.empty() || settings.method == kLabelsMethod) return absl::OkStatus();
  const size_t images = survey.views.size();
  return InputError("images", "",
                    images == 1 ? "1 image" : absl::StrCat(images, " images, no two of which show the same surface"),
                    "at least 2 images of the same surface, from directions 2.5 to 45 degrees apart; 3 are better");
}

Status CheckQuote(const JobSettings& settings, const Survey& survey) {
  TESSERA_RETURN_IF_ERROR(CheckPairs(settings, survey));
  if (settings.max_core_seconds == 0) return absl::OkStatus();
  TESSERA_ASSIGN_OR_RETURN(const Quote quote, MakeQuote(settings, survey));
  return CheckLimit(settings, quote.core_seconds);
}

Status CheckLimit(const JobSettings& settings, double core_seconds) {
  if (settings.max_core_seconds == 0 || core_seconds <= settings.max_core_seconds) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat(
      "predicted cost: found %.4g core-seconds, more than the limit of %.4g; raise --max-price or reduce the job",
      core_seconds, settings.max_core_seconds));
}

}  // namespace tessera
