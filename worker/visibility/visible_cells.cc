#include "worker/visibility/visible_cells.h"

#include <algorithm>
#include <utility>

#include "common/base/parallel.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

constexpr int kBlock_px = 8;  // needed pixels are recorded in squares of this size

// A set of square blocks of an image.
class PixelSet {
 public:
  explicit PixelSet(const PixelRect& domain)
      : domain_(domain),
        columns_((domain.width() + kBlock_px - 1) / kBlock_px),
        rows_((domain.height() + kBlock_px - 1) / kBlock_px),
        marks_(static_cast<size_t>(columns_) * rows_, 0) {}

  void Add(const PixelRect& rect) {
    ForRows(rect, [](uint8_t* begin, uint8_t* end) { return std::fill(begin, end, 1), false; });
  }
  bool Meets(const PixelRect& rect) {
    return ForRows(rect, [](uint8_t* begin, uint8_t* end) { return std::find(begin, end, 1) != end; });
  }
  PixelRect Bounds() const {
    PixelRect bounds = {columns_, rows_, 0, 0};
    for (int y = 0; y < rows_; ++y) {
      for (int x = 0; x < columns_; ++x) {
        if (!marks_[static_cast<size_t>(y) * columns_ + x]) continue;
        bounds = {std::min(bounds.x0, x), std::min(bounds.y0, y), std::max(bounds.x1, x + 1),
                  std::max(bounds.y1, y + 1)};
      }
    }
    if (bounds.empty()) return {};
    return {domain_.x0 + bounds.x0 * kBlock_px, domain_.y0 + bounds.y0 * kBlock_px,
            std::min(domain_.x0 + bounds.x1 * kBlock_px, domain_.x1),
            std::min(domain_.y0 + bounds.y1 * kBlock_px, domain_.y1)};
  }

 private:
  // Calls body(begin, end) for each row of blocks of a rectangle until it returns true.
  template <class Body>
  bool ForRows(const PixelRect& rect, const Body& body) {
    if (rect.empty()) return false;
    // Rectangles are clipped to the domain.
    const int x0 = (rect.x0 - domain_.x0) / kBlock_px, x1 = (rect.x1 - 1 - domain_.x0) / kBlock_px;
    const int y0 = (rect.y0 - domain_.y0) / kBlock_px, y1 = (rect.y1 - 1 - domain_.y0) / kBlock_px;
    for (int y = y0; y <= y1; ++y) {
      uint8_t* row = &marks_[static_cast<size_t>(y) * columns_];
      if (body(row + x0, row + x1 + 1)) return true;
    }
    return false;
  }
  PixelRect domain_;
  int columns_, rows_;
  std::vector<uint8_t> marks_;
};

// A cell and the bounds of its projection in a view.
struct CellPixels {
  uint32_t cell = 0;
  PixelRect pixels;
};

// Calls body for the elements of `in_view` whose cell is in `cells`. Both are ascending.
template <class Body>
void ForCells(const std::vector<CellPixels>& in_view, const std::vector<uint32_t>& cells, const Body& body) {
  size_t at = 0;
  for (const uint32_t cell : cells) {
    while (at < in_view.size() && in_view[at].cell < cell) ++at;
    if (at < in_view.size() && in_view[at].cell == cell) body(in_view[at]);
  }
}

PixelRect Widened(const PixelRect& r, int margin, const PixelRect& domain) {
  return {std::max(r.x0 - margin, domain.x0), std::max(r.y0 - margin, domain.y0), std::min(r.x1 + margin, domain.x1),
          std::min(r.y1 + margin, domain.y1)};
}

}  // namespace

std::vector<std::vector<uint32_t>> OwnCellsOfViews(const MeshCells& cells, const std::vector<uint8_t>& own,
                                                   const std::vector<std::vector<uint8_t>>& selected, size_t views) {
  std::vector<std::vector<uint32_t>> of_views(views);
  for (uint32_t c = 0; c < cells.size(); ++c) {
    const auto first = own.begin() + cells.face_begin[c], last = own.begin() + cells.face_begin[c + 1];
    if (std::find_if(first, last, [](uint8_t flag) { return flag != 0; }) == last) continue;
    for (size_t v = 0; v < views; ++v) {
      if (selected[c][v]) of_views[v].push_back(c);
    }
  }
  return of_views;
}

VisibleCells FindVisibleCells(const VisibleCellsProblem& problem) {
  const size_t views = problem.views.size(), cells = problem.boxes.size();
  const std::vector<Eigen::AlignedBox3d> runs = RunsOf(problem.boxes);
  std::vector<PixelSet> needed;
  for (const CameraWindow& view : problem.views) needed.emplace_back(view.rect);
  std::vector<std::vector<CellPixels>> in_view(views);  // ascending
  std::vector<std::vector<uint32_t>> shown(views), lands(views);
  ParallelForEach(views, 1, [&](int64_t v) {
    const CameraWindow& view = problem.views[v];
    for (uint32_t run = 0; run < runs.size(); ++run) {
      if (PixelsOf(view, runs[run], kNearPlane_m, 0).empty()) continue;
      const auto last = static_cast<uint32_t>(std::min<size_t>(cells, (run + 1) * kRunCells));
      for (uint32_t c = run * kRunCells; c < last; ++c) {
        const PixelRect pixels = PixelsOf(view, problem.boxes[c], kNearPlane_m, 0);
        if (!pixels.empty()) in_view[v].push_back({c, pixels});
      }
    }
    ForCells(in_view[v], problem.own[v], [&](const CellPixels& own) {
      needed[v].Add(Widened(own.pixels, problem.reference_margin_px, view.rect));
    });
    for (const CellPixels& other : in_view[v]) {
      if (needed[v].Meets(other.pixels)) shown[v].push_back(other.cell);
    }
  });
  for (const auto& [reference, other] : problem.pairs) {
    lands[other].insert(lands[other].end(), shown[reference].begin(), shown[reference].end());
  }
  VisibleCells visible;
  visible.cells.resize(views);
  visible.windows.resize(views);
  visible.own_windows.resize(views);
  ParallelForEach(views, 1, [&](int64_t v) {
    visible.own_windows[v] = needed[v].Bounds();
    std::sort(lands[v].begin(), lands[v].end());
    lands[v].erase(std::unique(lands[v].begin(), lands[v].end()), lands[v].end());
    ForCells(in_view[v], lands[v], [&](const CellPixels& landing) {
      needed[v].Add(Widened(landing.pixels, problem.target_margin_px, problem.views[v].rect));
    });
    visible.windows[v] = needed[v].Bounds();
    for (const CellPixels& other : in_view[v]) {
      if (needed[v].Meets(other.pixels)) visible.cells[v].push_back(other.cell);
    }
  });
  visible.own_cells = std::move(shown);
  return visible;
}

}  // namespace tessera
