#include "server/plan/quote.h"

#include <algorithm>
#include <functional>

#include "server/plan/graph.h"
#include "server/plan/tiling.h"

namespace tessera {
namespace {

double Makespan(std::vector<double> seconds, int workers) {
  std::sort(seconds.begin(), seconds.end(), std::greater<>());
  std::vector<double> busy_until(std::max(1, workers), 0.0);  // a heap, the earliest first
  for (const double s : seconds) {
    std::pop_heap(busy_until.begin(), busy_until.end(), std::greater<>());
    busy_until.back() += s;
    std::push_heap(busy_until.begin(), busy_until.end(), std::greater<>());
  }
  return *std::max_element(busy_until.begin(), busy_until.end());
}

}  // namespace

int64_t TileQuote::peak_bytes() const {
  return std::max({cut.peak_bytes, crop.peak_bytes, refine.peak_bytes, stitch.peak_bytes});
}

StatusOr<Quote> MakeQuote(const JobSettings& settings, const Survey& survey) {
  Quote quote;
  TESSERA_ASSIGN_OR_RETURN(quote.halo_m, HaloOf(settings, survey));
  const CellIndex cells(survey);
  TESSERA_ASSIGN_OR_RETURN(const std::vector<CellRect> cores,
                           LayOutTiles(cells, TilingOptionsOf(settings, quote.halo_m)));
  const std::vector<RefineEffort> parts = EffortsOf(settings, PartsOf(settings, cores.size()));
  quote.ingest = PredictIngest(survey);
  quote.publish = PredictPublish(survey);
  quote.interval = RefineSecondsInterval();
  quote.area_m2 = static_cast<double>(survey.cells.size()) * survey.ground.cell_m * survey.ground.cell_m;
  quote.core_seconds = quote.ingest.core_seconds + quote.publish.core_seconds;
  quote.peak_bytes = std::max(quote.ingest.peak_bytes, quote.publish.peak_bytes);
  for (const CellRect& core : cores) {
    TileQuote tile;
    tile.tile = static_cast<int>(quote.tiles.size());
    tile.core = core;
    tile.work = MeasureTile(cells, core, quote.halo_m);
    tile.cut = PredictCut(survey, tile.work);
    tile.crop = PredictCrop(tile.work);
    tile.refine = PredictRefine(tile.work, parts);
    tile.stitch = PredictStitch(tile.work);
    quote.core_faces += tile.work.core_faces;
    quote.faces += tile.work.faces;
    quote.core_seconds += tile.core_seconds();
    quote.peak_bytes = std::max(quote.peak_bytes, tile.peak_bytes());
    quote.tiles.push_back(std::move(tile));
  }
  return quote;
}

double WallSeconds(const Quote& quote, int workers, int threads) {
  std::vector<double> cut, crop, refine, stitch;
  for (const TileQuote& tile : quote.tiles) {
    cut.push_back(tile.cut.core_seconds);
    crop.push_back(tile.crop.core_seconds);
    refine.push_back(tile.refine.core_seconds);
    stitch.push_back(tile.stitch.core_seconds);
  }
  return (quote.ingest.core_seconds + Makespan(std::move(cut), workers) + Makespan(std::move(crop), workers) +
          Makespan(std::move(refine), workers) + Makespan(std::move(stitch), workers) + quote.publish.core_seconds) /
         std::max(1, threads);
}

}  // namespace tessera
