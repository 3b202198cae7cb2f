#include "common/exporting/obj/tile_rects.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace tessera {
namespace {

constexpr double kRectTolerance = 0.01, kRectSnap = 1e-9;  // of the median side of a tile
constexpr size_t kMaxRectCells = size_t{4} << 20;

// An interval of a tile along one axis, and along the other one.
struct TileSpan {
  double low, high, other_low, other_high;
};

std::vector<TileSpan> TileSpansAlong(int axis, std::span<const PlanRect> rects) {
  std::vector<TileSpan> spans;
  for (const PlanRect& r : rects) {
    if (r.IsEmpty()) continue;
    if (axis == 0) spans.push_back({r.x0, r.x1, r.y0, r.y1});
    if (axis == 1) spans.push_back({r.y0, r.y1, r.x0, r.x1});
  }
  return spans;
}

double MedianTileSide(std::span<const PlanRect> rects) {
  std::vector<double> sides;
  for (const PlanRect& r : rects) {
    if (!r.IsEmpty()) sides.insert(sides.end(), {r.x1 - r.x0, r.y1 - r.y0});
  }
  if (sides.empty()) return 0;
  const auto middle = sides.begin() + static_cast<std::ptrdiff_t>(sides.size() / 2);
  std::nth_element(sides.begin(), middle, sides.end());
  return *middle;
}

// The edges of tiles that make one line, which is their median.
struct EdgeCluster {
  double line = 0;
  std::vector<size_t> low, high;  // tiles that begin there, and that end there
};

std::vector<EdgeCluster> EdgeClustersOf(const std::vector<TileSpan>& spans, double tolerance) {
  std::vector<std::pair<double, size_t>> edges;  // position, 2 * tile + (0: its low edge, 1: its high edge)
  for (size_t k = 0; k < spans.size(); ++k) {
    edges.insert(edges.end(), {{spans[k].low, 2 * k}, {spans[k].high, 2 * k + 1}});
  }
  std::sort(edges.begin(), edges.end());
  std::vector<EdgeCluster> clusters;
  for (size_t first = 0, last = 0; first < edges.size(); first = last) {
    EdgeCluster& cluster = clusters.emplace_back();
    for (; last < edges.size() && edges[last].first <= edges[first].first + tolerance; ++last) {
      const size_t edge = edges[last].second;
      (edge % 2 == 0 ? cluster.low : cluster.high).push_back(edge / 2);
    }
    cluster.line = edges[(first + last - 1) / 2].first;
  }
  return clusters;
}

// Whether a tile ends and another one begins at the line, beside each other.
bool TilesMeetAt(const EdgeCluster& cluster, const std::vector<TileSpan>& spans, double tolerance) {
  for (const size_t a : cluster.high) {
    for (const size_t b : cluster.low) {
      const double overlap =
          std::min(spans[a].other_high, spans[b].other_high) - std::max(spans[a].other_low, spans[b].other_low);
      if (overlap > tolerance) return true;
    }
  }
  return false;
}

std::vector<double> LinesWhereTilesMeet(const std::vector<TileSpan>& spans, double tolerance) {
  std::vector<double> lines;
  for (const EdgeCluster& cluster : EdgeClustersOf(spans, tolerance)) {
    if (TilesMeetAt(cluster, spans, tolerance)) lines.push_back(cluster.line);
  }
  return lines;
}

std::vector<double> AllTileLines(const std::vector<TileSpan>& spans, double tolerance) {
  std::vector<double> lines;
  for (const EdgeCluster& cluster : EdgeClustersOf(spans, tolerance)) lines.push_back(cluster.line);
  return lines;
}

size_t RectCellOf(const std::vector<double>& lines, double position) {
  return static_cast<size_t>(std::upper_bound(lines.begin(), lines.end(), position) - lines.begin());
}

// The cell that has the interval but for `tolerance`; none: -1.
int64_t RectCellWith(const std::vector<double>& lines, double low, double high, double tolerance) {
  const size_t cell = RectCellOf(lines, (low + high) / 2);
  const bool fits =
      (cell == 0 || low >= lines[cell - 1] - tolerance) && (cell == lines.size() || high <= lines[cell] + tolerance);
  return fits ? static_cast<int64_t>(cell) : -1;
}

// The number of the line that the edge at `position` became.
size_t NearestRectLine(const std::vector<double>& lines, double position) {
  const size_t above = RectCellOf(lines, position);
  if (above == 0) return 0;
  if (above == lines.size() || position - lines[above - 1] <= lines[above] - position) return above - 1;
  return above;
}

// A point of a cell: its middle; of a cell without end, on its line.
double MiddleOfRectCell(const std::vector<double>& lines, size_t cell) {
  if (lines.empty()) return 0;
  if (cell == 0) return lines.front();
  if (cell == lines.size()) return lines.back();
  return (lines[cell - 1] + lines[cell]) / 2;
}

double SquaredRectDistance(const PlanRect& rect, double x, double y) {
  const double dx = x - std::clamp(x, rect.x0, rect.x1), dy = y - std::clamp(y, rect.y0, rect.y1);
  return dx * dx + dy * dy;
}

}  // namespace

TileRects TileRects::Of(std::span<const PlanRect> rects) {
  TileRects out;
  const double side = MedianTileSide(rects);
  if (side == 0) return out;
  out.snap_ = kRectSnap * side;
  double tolerance = kRectTolerance * side;
  if (!out.MakeGrid(rects, tolerance)) out.MakeCells(rects, tolerance);
  out.GiveToNearest(rects);
  out.RemoveIdleLines();
  return out;
}

bool TileRects::MakeGrid(std::span<const PlanRect> rects, double tolerance) {
  xs_ = LinesWhereTilesMeet(TileSpansAlong(0, rects), tolerance);
  ys_ = LinesWhereTilesMeet(TileSpansAlong(1, rects), tolerance);
  const size_t columns = xs_.size() + 1, cells = columns * (ys_.size() + 1);
  if (cells > kMaxRectCells) return false;
  owners_.assign(cells, -1);
  for (size_t k = 0; k < rects.size(); ++k) {
    if (rects[k].IsEmpty()) continue;
    const int64_t column = RectCellWith(xs_, rects[k].x0, rects[k].x1, tolerance);
    const int64_t row = RectCellWith(ys_, rects[k].y0, rects[k].y1, tolerance);
    if (column < 0 || row < 0) return false;
    int32_t& owner = owners_[static_cast<size_t>(row) * columns + static_cast<size_t>(column)];
    if (owner >= 0) return false;
    owner = static_cast<int32_t>(k);
  }
  return true;
}

void TileRects::MakeCells(std::span<const PlanRect> rects, double tolerance) {
  const std::vector<TileSpan> spans_x = TileSpansAlong(0, rects), spans_y = TileSpansAlong(1, rects);
  do {
    xs_ = AllTileLines(spans_x, tolerance);
    ys_ = AllTileLines(spans_y, tolerance);
    tolerance *= 2;
  } while ((xs_.size() + 1) * (ys_.size() + 1) > kMaxRectCells);
  const size_t columns = xs_.size() + 1;
  owners_.assign(columns * (ys_.size() + 1), -1);
  for (size_t k = 0; k < rects.size(); ++k) {
    const PlanRect& r = rects[k];
    if (r.IsEmpty()) continue;
    const size_t column_end = NearestRectLine(xs_, r.x1) + 1, row_end = NearestRectLine(ys_, r.y1) + 1;
    for (size_t row = NearestRectLine(ys_, r.y0) + 1; row < row_end; ++row) {
      for (size_t column = NearestRectLine(xs_, r.x0) + 1; column < column_end; ++column) {
        int32_t& owner = owners_[row * columns + column];
        if (owner < 0) owner = static_cast<int32_t>(k);
      }
    }
  }
}

// Passes the nearest tile from cell to cell, forwards and backwards, as distance transforms of images do.
void TileRects::GiveToNearest(std::span<const PlanRect> rects) {
  const size_t columns = xs_.size() + 1, rows = ys_.size() + 1;
  std::vector<double> distances(owners_.size(), std::numeric_limits<double>::infinity());
  for (size_t cell = 0; cell < owners_.size(); ++cell) {
    if (owners_[cell] >= 0) distances[cell] = -1;  // stays
  }
  const auto take_from = [&](size_t cell, size_t neighbour) {
    const int32_t tile = owners_[neighbour];
    if (tile < 0) return;
    const double distance = SquaredRectDistance(rects[static_cast<size_t>(tile)], MiddleOfRectCell(xs_, cell % columns),
                                                MiddleOfRectCell(ys_, cell / columns));
    if (distance > distances[cell] || (distance == distances[cell] && tile >= owners_[cell])) return;
    distances[cell] = distance;
    owners_[cell] = tile;
  };
  const auto visit = [&](size_t cell) {
    if (distances[cell] < 0) return;
    const size_t column = cell % columns, row = cell / columns;
    if (column > 0) take_from(cell, cell - 1);
    if (column + 1 < columns) take_from(cell, cell + 1);
    if (row > 0) take_from(cell, cell - columns);
    if (row + 1 < rows) take_from(cell, cell + columns);
  };
  for (int pass = 0; pass < 2; ++pass) {
    for (size_t cell = 0; cell < owners_.size(); ++cell) visit(cell);
    for (size_t cell = owners_.size(); cell > 0; --cell) visit(cell - 1);
  }
}

// Removes lines that have the same owner on both sides everywhere, which would cut faces for nothing.
void TileRects::RemoveIdleLines() {
  const size_t columns = xs_.size() + 1, rows = ys_.size() + 1;
  std::vector<size_t> kept_columns = {0}, kept_rows = {0};
  std::vector<double> xs, ys;
  for (size_t column = 1; column < columns; ++column) {
    bool idle = true;
    for (size_t row = 0; row < rows && idle; ++row) idle = OwnerOf(column - 1, row) == OwnerOf(column, row);
    if (idle) continue;
    kept_columns.push_back(column);
    xs.push_back(xs_[column - 1]);
  }
  for (size_t row = 1; row < rows; ++row) {
    bool idle = true;
    for (size_t column = 0; column < columns && idle; ++column) idle = OwnerOf(column, row - 1) == OwnerOf(column, row);
    if (idle) continue;
    kept_rows.push_back(row);
    ys.push_back(ys_[row - 1]);
  }
  std::vector<int32_t> owners;
  for (const size_t row : kept_rows) {
    for (const size_t column : kept_columns) owners.push_back(OwnerOf(column, row));
  }
  xs_ = std::move(xs);
  ys_ = std::move(ys);
  owners_ = std::move(owners);
}

int32_t TileRects::TileAt(const Eigen::Vector2d& point) const {
  return OwnerOf(RectCellOf(xs_, point.x()), RectCellOf(ys_, point.y()));
}

}  // namespace tessera
