#include "server/tiling/tiling.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace tessera {
namespace {

constexpr int kMaxParts = 1 << 20, kTries = 4;
constexpr double kFarTooLarge = 4;
// A cut across the longer side whose larger part has this much work, relative to an even share, is not compared with one
// across the shorter side, since that has the longer border.
constexpr double kFairExcess = 1.05;

// Bounding rectangle of the cells in `rect`.
CellRect Tightened(const CellIndex& cells, const CellRect& rect) {
  CellRect tight = {rect.x1, rect.y1, rect.x0, rect.y0};
  cells.ForEachIn(rect, [&](const SurveyCell& cell) {
    tight = {std::min(tight.x0, cell.x), std::min(tight.y0, cell.y), std::max(tight.x1, cell.x + 1),
             std::max(tight.y1, cell.y + 1)};
  });
  return tight;
}

class KdSplitter {
 public:
  KdSplitter(const CellIndex& cells, const TilingOptions& options)
      : cells_(cells), options_(options), limit_bytes_(TileLimit_bytes(options.tiles, options.tile_bytes)) {}

  StatusOr<std::vector<CellRect>> Run() {
    TESSERA_RETURN_IF_ERROR(Split(cells_.bounds(), std::max(1, options_.tiles)));
    return std::move(tiles_);
  }

 private:
  // Splits `rect` into at least `parts` tiles, or as many as it has cells.
  Status Split(const CellRect& given, int parts) {
    const CellRect rect = Tightened(cells_, given);
    int count = 0;
    double faces = 0;
    cells_.ForEachIn(rect, [&](const SurveyCell& cell) {
      ++count;
      faces += static_cast<double>(cell.faces);
    });
    parts = std::min(parts, count);
    if (parts <= 1) {
      // Skip the exact computation for parts that are far too large.
      if (count > 1 && static_cast<double>(LeastTileBytes(faces)) > kFarTooLarge * static_cast<double>(limit_bytes_)) {
        parts = 2;
      } else {
        const double excess = Excess(rect);
        if (count == 1) TESSERA_RETURN_IF_ERROR(CheckCell(rect));
        if (excess <= 1 || count == 1) {
          tiles_.push_back(rect);
          return absl::OkStatus();
        }
        // The smallest number of equal parts that all fit; their halos make it larger than the excess.
        const int fewest = static_cast<int>(std::clamp(std::ceil(excess), 2.0, std::min<double>(count, kMaxParts)));
        for (parts = fewest; parts <= std::min(count, fewest + kTries); ++parts) {
          std::vector<CellRect> trial;
          SplitEvenly(rect, parts, &trial);
          if (!std::all_of(trial.begin(), trial.end(), [&](const CellRect& part) { return Excess(part) <= 1; }))
            continue;
          tiles_.insert(tiles_.end(), trial.begin(), trial.end());
          return absl::OkStatus();
        }
        parts = 2;
      }
    }
    const Cut cut = BestCut(rect, parts);
    const auto [low, high] = Halves(rect, cut);
    TESSERA_RETURN_IF_ERROR(Split(low, cut.low_parts));
    return Split(high, parts - cut.low_parts);
  }

  void SplitEvenly(const CellRect& given, int parts, std::vector<CellRect>* out) const {
    const CellRect rect = Tightened(cells_, given);
    if (parts <= 1) {
      out->push_back(rect);
      return;
    }
    const Cut cut = BestCut(rect, parts);
    const auto [low, high] = Halves(rect, cut);
    SplitEvenly(low, cut.low_parts, out);
    SplitEvenly(high, parts - cut.low_parts, out);
  }

  // At the upper end of the prediction interval.
  double PredictBytes(const CellRect& rect, const TileWork& work) const {
    return kRefineBytesInterval.high *
           static_cast<double>(PredictTileBytes(work, options_.effort, rect == cells_.bounds()));
  }

  // Predicted memory of a tile beyond a worker's base memory, relative to the available room; above 1 it does not fit.
  double Excess(const CellRect& rect) const {
    if (limit_bytes_ == std::numeric_limits<int64_t>::max()) return 0;
    const double bytes = PredictBytes(rect, MeasureTile(cells_, rect));
    const double fixed = static_cast<double>(LeastTileBytes(0)), room = static_cast<double>(limit_bytes_) - fixed;
    return room > 0 ? (bytes - fixed) / room : std::numeric_limits<double>::infinity();
  }

  Status CheckCell(const CellRect& rect) const {
    if (limit_bytes_ == std::numeric_limits<int64_t>::max()) return absl::OkStatus();
    const TileWork work = MeasureTile(cells_, rect);
    const double bytes = PredictBytes(rect, work);
    if (bytes <= static_cast<double>(limit_bytes_)) return absl::OkStatus();
    constexpr double kGiB = 1 << 30;
    PinholeCamera largest;
    for (const int32_t v : work.views) {
      const PinholeCamera& camera = cells_.survey().views[v].lens.pinhole;
      if (int64_t{camera.width} * camera.height > int64_t{largest.width} * largest.height) largest = camera;
    }
    return absl::InvalidArgumentError(absl::StrFormat(
        "tile memory: found %.2f GiB, expected at least %.2f GiB for the ground cell at (%d, %d) alone: "
        "%.0f faces, %.0f more faces around it that its refinement reads, %d views, %.1f megapixels of images (the "
        "largest has %d x %d "
        "pixels); raise --tile-memory, use images of half the size, or drop the finest of --levels",
        static_cast<double>(limit_bytes_) / kGiB, bytes / kGiB, rect.x0, rect.y0, work.core_faces,
        work.package_faces - work.core_faces, work.seeing_views, 1e-6 * work.pixels, largest.width, largest.height));
  }

  struct Cut {
    bool along_x = true;
    int at = 0;
    int low_parts = 1;
    double excess = std::numeric_limits<double>::infinity();  // work of the larger side / an even share
  };

  static std::pair<CellRect, CellRect> Halves(const CellRect& rect, const Cut& cut) {
    CellRect low = rect, high = rect;
    (cut.along_x ? low.x1 : low.y1) = cut.at;
    (cut.along_x ? high.x0 : high.y0) = cut.at;
    return {low, high};
  }

  Cut BestCut(const CellRect& rect, int parts) const {
    const bool long_x = rect.x1 - rect.x0 >= rect.y1 - rect.y0;
    const Cut cut = BestCutAlong(rect, parts, long_x);
    if (cut.excess <= kFairExcess) return cut;
    const Cut other = BestCutAlong(rect, parts, !long_x);
    return other.excess < cut.excess ? other : cut;
  }

  Cut BestCutAlong(const CellRect& rect, int parts, bool along_x) const {
    const int begin = along_x ? rect.x0 : rect.y0, size = (along_x ? rect.x1 : rect.y1) - begin;
    std::vector<double> work(size, 0.0);
    std::vector<int> count(size, 0);
    double total = 0;
    int total_count = 0;
    cells_.ForEachIn(rect, [&](const SurveyCell& cell) {
      const double seconds = PredictCellSeconds(cell, cells_.survey(), options_.effort);
      const int place = (along_x ? cell.x : cell.y) - begin;
      work[place] += seconds;
      ++count[place];
      total += seconds;
      ++total_count;
    });
    // Give each side about half of the parts, so that the halves can be balanced again.
    Cut best;
    best.along_x = along_x;
    double low = 0;
    int low_count = 0;
    for (int at = 1; at < size; ++at) {
      low += work[at - 1];
      low_count += count[at - 1];
      const int least = std::max(1, parts - (total_count - low_count)), most = std::min(parts - 1, low_count);
      if (least > most || low_count == total_count) continue;
      for (const int wanted : {parts / 2, parts - parts / 2}) {
        const int low_parts = std::clamp(wanted, least, most);
        const double excess = std::max(low / low_parts, (total - low) / (parts - low_parts)) * parts / total;
        if (excess < best.excess) best = {along_x, begin + at, low_parts, excess};
      }
    }
    return best;
  }

  const CellIndex& cells_;
  const TilingOptions& options_;
  const int64_t limit_bytes_;
  std::vector<CellRect> tiles_;
};

}  // namespace

int64_t TileLimit_bytes(int tiles, int64_t tile_bytes) {
  if (tile_bytes > 0) return tile_bytes;
  return tiles > 0 ? std::numeric_limits<int64_t>::max() : kDefaultTileBytes;
}

double PredictCellSeconds(const SurveyCell& cell, const Survey& survey, const JobEffort& effort) {
  // Treats the cell as a tile whose crops show its square at the median GSD; each view has its share of partners.
  TileWork work;
  const double side_px = survey.ground.cell_m / survey.gsd_m, views = static_cast<double>(cell.views.size());
  const double partners =
      survey.views.empty() ? 0 : static_cast<double>(survey.pairs.size()) / static_cast<double>(survey.views.size());
  work.core_faces = work.solve_faces = work.visible_faces = static_cast<double>(cell.faces);
  work.drawn_faces = work.core_faces * views;
  work.pixels = views * side_px * side_px;
  work.pair_pixels = work.pixels * std::min(partners, std::max(0.0, views - 1));
  // Cells without views have work too: fold repair.
  return PredictCrop(work).core_seconds + OfParts(PredictRefine, work, effort).core_seconds;
}

int64_t PredictTileBytes(const TileWork& work, const JobEffort& effort, bool only) {
  const int64_t crop = PredictCrop(work).peak_bytes;
  if (only) return std::max(crop, OfParts(PredictRefine, work, effort).peak_bytes);
  return std::max({crop, OfParts(PredictMeasure, work, effort).peak_bytes,
                   OfParts(PredictSolve, work, effort).peak_bytes, OfParts(PredictMend, work, effort).peak_bytes});
}

TilingOptions TilingOptionsOf(const JobSettings& settings, const Survey& survey) {
  TilingOptions options;
  options.tiles = settings.tiles;
  options.tile_bytes = settings.tile_memory_bytes;
  options.effort = EffortOf(settings, survey);
  return options;
}

StatusOr<std::vector<CellRect>> LayOutTiles(const CellIndex& cells, const TilingOptions& options) {
  if (cells.survey().cells.empty()) return absl::InvalidArgumentError("survey: found no cells with faces");
  return KdSplitter(cells, options).Run();
}

}  // namespace tessera
