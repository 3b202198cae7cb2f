#include "worker/changes/measure_changes.h"

#include <algorithm>
#include <cmath>

#include "common/base/parallel.h"
#include "worker/changes/block_labels.h"
#include "worker/changes/ground_match.h"
#include "worker/changes/surface_raster.h"

namespace tessera {
namespace {

// Cost of a window without any agreement. Windows that no pair shows cost about as much as chance agreement.
constexpr float kUnit = 100;
constexpr uint8_t kUnseen = 60;
constexpr double kLowShare = 0.1;  // quantile of the old heights that defines the block's low ground

// Heights of the sweep: multiples of the step.
struct Heights {
  double first_m = 0, step_m = 1;
  int count = 0;
  double At(int level) const { return first_m + level * step_m; }
};

struct Range {
  double low_m = 0, high_m = 0;
  bool known = false;
};

Range OldRange(std::span<const TopSurface::Point> points) {
  std::vector<float> heights;
  for (const TopSurface::Point& p : points) {
    if (!std::isnan(p.height_m)) heights.push_back(p.height_m);
  }
  if (heights.empty()) return {};
  const auto low = heights.begin() + static_cast<size_t>(kLowShare * static_cast<double>(heights.size()));
  std::nth_element(heights.begin(), low, heights.end());
  return {*low, *std::max_element(heights.begin(), heights.end()), true};
}

CellRect Grown(const CellRect& rect, int cells) {
  return {rect.x0 - cells, rect.y0 - cells, rect.x1 + cells, rect.y1 + cells};
}

Eigen::AlignedBox2d Metres(const CellRect& rect, double cell_m) {
  return {Eigen::Vector2d(rect.x0, rect.y0) * cell_m, Eigen::Vector2d(rect.x1, rect.y1) * cell_m};
}

std::vector<CellRect> Blocks(const CellRect& cells) {
  const CellRect all = WholeBlocks(cells);
  std::vector<CellRect> blocks;
  for (int y = all.y0; y < all.y1; y += kBlockCells) {
    for (int x = all.x0; x < all.x1; x += kBlockCells) blocks.push_back({x, y, x + kBlockCells, y + kBlockCells});
  }
  return blocks;
}

SampleGrid GridOf(const CellRect& block, double cell_m, double gsd_m) {
  SampleGrid grid;
  grid.cells = Grown(block, kBlockMargin);
  grid.cell_m = cell_m;
  grid.samples_per_cell = std::clamp(static_cast<int>(std::lround(cell_m / gsd_m)), 2, 5);
  // Windows of about seven samples, centred on the cell.
  grid.window_samples = grid.samples_per_cell % 2 == 1 ? 7 : 8;
  return grid;
}

// Bounding rectangle of the block's cells with an old surface; empty if there is none.
CellRect KnownPart(const TopSurface& surface, const CellRect& block, double cell_m) {
  CellRect part{block.x1, block.y1, block.x0, block.y0};
  for (int y = block.y0; y < block.y1; ++y) {
    for (int x = block.x0; x < block.x1; ++x) {
      if (std::isnan(surface.At((x + 0.5) * cell_m, (y + 0.5) * cell_m).height_m)) continue;
      part = {std::min(part.x0, x), std::min(part.y0, y), std::max(part.x1, x + 1), std::max(part.y1, y + 1)};
    }
  }
  return part;
}

std::vector<TopSurface::Point> OldSamples(const TopSurface& surface, const SampleGrid& grid) {
  std::vector<TopSurface::Point> points;
  points.reserve(static_cast<size_t>(grid.rows()) * grid.columns());
  for (int j = 0; j < grid.rows(); ++j) {
    for (int i = 0; i < grid.columns(); ++i) points.push_back(surface.At(grid.X_m(i), grid.Y_m(j)));
  }
  return points;
}

// Drops the samples of the grid's margin.
std::vector<TopSurface::Point> WithoutMargin(const std::vector<TopSurface::Point>& points, const SampleGrid& grid) {
  const int margin = grid.margin_cells() * grid.samples_per_cell;
  std::vector<TopSurface::Point> own;
  for (int j = margin; j < grid.rows() - margin; ++j) {
    const auto row = points.begin() + static_cast<size_t>(j) * grid.columns();
    own.insert(own.end(), row + margin, row + grid.columns() - margin);
  }
  return own;
}

// Cells next to a jump of the old surface.
std::vector<uint8_t> OldEdges(const SurfaceRaster& before, double jump_m) {
  std::vector<uint8_t> edge(before.size(), 0);
  const int width = before.width();
  for (int y = 0; y < before.height(); ++y) {
    for (int x = 0; x < width; ++x) {
      const size_t i = static_cast<size_t>(y) * width + x;
      const auto jumps = [&](size_t j) { return std::abs(before.height_m[i] - before.height_m[j]) > jump_m; };
      if (x + 1 < width && jumps(i + 1)) edge[i] = edge[i + 1] = 1;
      if (y + 1 < before.height() && jumps(i + width)) edge[i] = edge[i + width] = 1;
    }
  }
  return edge;
}

uint8_t CostOf(float score) { return static_cast<uint8_t>(std::lround(kUnit * (1 - std::max(score, 0.0f)))); }

// Measures one block of the plane.
class BlockMeasurer {
 public:
  BlockMeasurer(const TopSurface& surface, const GroundPlane& ground, const CellRect& whole_block,
                std::span<const ChangeView> views, int classes, double gsd_m, const MeasureOptions& options)
      : ground_(ground), options_(options), gsd_m_(gsd_m), classes_(classes), views_(views) {
    const CellRect block = KnownPart(surface, whole_block, ground.cell_m);
    if (block.x0 >= block.x1) return;
    grid_ = GridOf(block, ground.cell_m, gsd_m);
    samples_ = OldSamples(surface, grid_);
    range_ = OldRange(samples_);
    raster_ = ChangeRaster(grid_.cells, ground.cell_m);
    raster_.before = CellsOfSamples(WithoutMargin(samples_, grid_), grid_.cells, ground.cell_m, grid_.samples_per_cell);
    if (!range_.known) return;
    std::vector<PosedCamera> cameras;
    for (const ChangeView& view : views) cameras.push_back(view.camera);
    choice_ = ChooseViews(cameras, ground, Metres(block, ground.cell_m), range_.low_m, options.views);
  }

  // Returns the raster of the block with its margin.
  ChangeRaster Measure() {
    if (!range_.known || choice_.pairs.empty()) return raster_;
    const BlockLikelihoods likelihoods(grid_.cells, ground_, views_, choice_, classes_);
    Sweep(likelihoods);
    ChooseHeights();
    Label(likelihoods);
    return raster_;
  }

 private:
  size_t cells() const { return raster_.before.size(); }

  void Sweep(const BlockLikelihoods& likelihoods) {
    heights_.step_m = options_.step_px * gsd_m_ / choice_.base_to_height;
    const double low_m = range_.low_m - options_.below_m;
    const double high_m = std::max(range_.low_m + options_.above_m, range_.high_m + options_.above_roofs_m);
    heights_.first_m = std::floor(low_m / heights_.step_m) * heights_.step_m;
    heights_.count = static_cast<int>(std::ceil((high_m - heights_.first_m) / heights_.step_m)) + 1;
    const int width = raster_.before.width(), height = raster_.before.height();
    match_ = CostVolume(width, height, heights_.count, kUnseen);
    cost_ = match_;
    GroundMatcher matcher(grid_, ground_, views_, choice_);
    std::vector<float> scores, agreement;
    for (int level = 0; level < heights_.count; ++level) {
      matcher.MatchPlane(heights_.At(level), &scores);
      if (classes_ > 1) likelihoods.Agreement(heights_.At(level), &agreement);
      for (size_t i = 0; i < cells(); ++i) {
        const size_t at = i * heights_.count + level;
        if (!std::isnan(scores[i])) match_.cost[at] = CostOf(scores[i]);
        float cost = match_.cost[at];
        if (classes_ > 1 && !std::isnan(agreement[i])) {
          cost += kUnit * static_cast<float>(options_.semantic_weight) * (1 - agreement[i]);
        }
        cost_.cost[at] = static_cast<uint8_t>(cost);
      }
    }
    std::vector<float> old_heights;
    for (const TopSurface::Point& p : samples_) old_heights.push_back(p.height_m);
    matcher.MatchSurface(old_heights, &raster_.before_score);
    FavourOldSurface();
  }

  // Replaces the cost at the two levels next to the old surface by that of its true shape, and subtracts the bonus.
  void FavourOldSurface() {
    for (size_t i = 0; i < cells(); ++i) {
      const float old_m = raster_.before.height_m[i];
      if (std::isnan(old_m)) continue;
      const double level = (old_m - heights_.first_m) / heights_.step_m;
      const int low = static_cast<int>(std::floor(level));
      for (int d = std::max(low, 0); d <= std::min(low + 1, heights_.count - 1); ++d) {
        const size_t at = i * heights_.count + d;
        const int semantic = cost_.cost[at] - match_.cost[at];
        if (!std::isnan(raster_.before_score[i])) {
          match_.cost[at] = std::min(match_.cost[at], CostOf(raster_.before_score[i]));
        }
        const double favoured = match_.cost[at] + semantic - kUnit * options_.old_bonus;
        cost_.cost[at] = static_cast<uint8_t>(std::max(favoured, 0.0));
      }
    }
  }

  void ChooseHeights() {
    const std::vector<uint8_t> edge = OldEdges(raster_.before, 2 * heights_.step_m);
    const std::vector<int16_t> sum = AggregateCosts(cost_, edge, options_.penalties);
    const int count = heights_.count;
    for (size_t i = 0; i < cells(); ++i) {
      const int16_t* own = &sum[i * count];
      const int best = static_cast<int>(std::min_element(own, own + count) - own);
      double level = best;
      if (best > 0 && best + 1 < count) {
        const double left = own[best - 1] - own[best], right = own[best + 1] - own[best];
        if (left + right > 0) level += 0.5 * (left - right) / (left + right);
      }
      raster_.after.height_m[i] = static_cast<float>(heights_.At(0) + level * heights_.step_m);
      const uint8_t* match = &match_.cost[i * count];
      const uint8_t least = *std::min_element(match + std::max(best - 1, 0), match + std::min(best + 2, count));
      raster_.after_score[i] = 1 - least / kUnit;
      // A height within one step of the old surface is replaced by it.
      const float old_m = raster_.before.height_m[i];
      if (std::abs(raster_.after.height_m[i] - old_m) > heights_.step_m) continue;
      raster_.after.height_m[i] = old_m;
    }
  }

  void Label(const BlockLikelihoods& likelihoods) {
    std::vector<float> sums, standing(cells());
    std::vector<int> seen, seen_before;
    // Views contradict the old surface only where they would see it past the surfaces that still stand. Cells hidden
    // behind a tall building match equally badly at every height.
    for (size_t i = 0; i < cells(); ++i) {
      standing[i] = std::min(raster_.after.height_m[i], raster_.before.height_m[i]);
    }
    likelihoods.Collect(raster_.before.height_m, standing, &sums, &seen_before);
    likelihoods.Collect(raster_.after.height_m, raster_.after.height_m, &sums, &seen);
    const int width = raster_.before.width(), height = raster_.before.height();
    std::vector<float> own(classes_);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const size_t i = static_cast<size_t>(y) * width + x;
        // If two views would see the old surface and do not, it is gone, even if the new surface is too low to be
        // seen.
        const float old_m = raster_.before.height_m[i];
        const bool known = std::isnan(old_m)
                               ? seen[i] >= 2
                               : seen_before[i] >= 2 && (seen[i] >= 2 || raster_.after.height_m[i] < old_m);
        if (!known) {
          raster_.after.height_m[i] = raster_.after_score[i] = raster_.before_score[i] = kNotKnown;
          continue;
        }
        // Average over the neighbours on the same surface.
        std::fill(own.begin(), own.end(), 0.0f);
        for (int j = std::max(y - 1, 0); j <= std::min(y + 1, height - 1); ++j) {
          for (int k = std::max(x - 1, 0); k <= std::min(x + 1, width - 1); ++k) {
            const size_t n = static_cast<size_t>(j) * width + k;
            if (!(std::abs(raster_.after.height_m[n] - raster_.after.height_m[i]) <= 2 * ground_.cell_m)) continue;
            for (int c = 0; c < classes_; ++c) own[c] += sums[n * classes_ + c];
          }
        }
        float all = 0;
        for (const float s : own) all += s;
        if (all <= 0) continue;
        const int best = static_cast<int>(std::max_element(own.begin(), own.end()) - own.begin());
        raster_.after.label[i] = static_cast<uint8_t>(best);
        const uint8_t old = raster_.before.label[i];
        if (old < classes_) raster_.label_margin[i] = (own[best] - own[old]) / all;
      }
    }
  }

  const GroundPlane& ground_;
  const MeasureOptions& options_;
  double gsd_m_;
  int classes_;
  std::span<const ChangeView> views_;
  SampleGrid grid_;
  std::vector<TopSurface::Point> samples_;
  Range range_;
  ViewChoice choice_;
  Heights heights_;
  CostVolume match_, cost_;  // images only; with likelihoods and the old surface's bonus
  ChangeRaster raster_;
};

int FloorToBlock(int cell) {
  return static_cast<int>(std::floor(static_cast<double>(cell) / kBlockCells)) * kBlockCells;
}

}  // namespace

CellRect WholeBlocks(const CellRect& cells) {
  return {FloorToBlock(cells.x0), FloorToBlock(cells.y0), FloorToBlock(cells.x1 + kBlockCells - 1),
          FloorToBlock(cells.y1 + kBlockCells - 1)};
}

std::vector<int> ViewsToMeasure(const MeshSpans& old_mesh, const GroundPlane& ground, const CellRect& cells,
                                const std::vector<PosedCamera>& cameras, double gsd_m, const MeasureOptions& options) {
  const TopSurface surface(old_mesh, ground);
  std::vector<uint8_t> needed(cameras.size(), 0);
  for (const CellRect& whole_block : Blocks(cells)) {
    const CellRect block = KnownPart(surface, whole_block, ground.cell_m);
    if (block.x0 >= block.x1) continue;
    const Range range = OldRange(OldSamples(surface, GridOf(block, ground.cell_m, gsd_m)));
    if (!range.known) continue;
    const ViewChoice choice = ChooseViews(cameras, ground, Metres(block, ground.cell_m), range.low_m, options.views);
    for (const int v : choice.views) needed[v] = 1;
  }
  std::vector<int> views;
  for (size_t v = 0; v < cameras.size(); ++v) {
    if (needed[v]) views.push_back(static_cast<int>(v));
  }
  return views;
}

ChangeRaster MeasureChanges(const MeshSpans& old_mesh, const GroundPlane& ground, const CellRect& cells,
                            std::span<const ChangeView> views, int classes, double gsd_m,
                            const MeasureOptions& options) {
  const TopSurface surface(old_mesh, ground);
  const std::vector<CellRect> blocks = Blocks(cells);
  ChangeRaster raster(cells, ground.cell_m);
  ParallelForEach(blocks.size(), 1, [&](int64_t b) {
    BlockMeasurer measurer(surface, ground, blocks[b], views, classes, gsd_m, options);
    CopyCells(measurer.Measure(), blocks[b], &raster);  // thread-safe: blocks share no cell
  });
  return raster;
}

}  // namespace tessera
