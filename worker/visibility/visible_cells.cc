#include "worker/visibility/visible_cells.h"

#include <algorithm>
#include <bit>
#include <span>
#include <utility>

#include "common/base/parallel.h"
#include "worker/visibility/bit_raster.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

constexpr int kBlock_px = 8;  // needed pixels are recorded in squares of this size

// A set of square blocks of an image.
class PixelSet {
 public:
  explicit PixelSet(const PixelRect& domain)
      : domain_(domain),
        blocks_((domain.width() + kBlock_px - 1) / kBlock_px, (domain.height() + kBlock_px - 1) / kBlock_px) {}

  void Add(const PixelRect& rect) {
    ForRows(rect, [&](int y, int x0, int x1) { return blocks_.Set(y, x0, x1), false; });
  }
  bool Meets(const PixelRect& rect) const {
    return ForRows(rect, [&](int y, int x0, int x1) { return blocks_.Meets(y, x0, x1); });
  }
  PixelRect Bounds() const {
    int x0 = domain_.width(), y0 = blocks_.height(), x1 = 0, y1 = 0;  // columns of blocks, rows of blocks
    for (int y = 0; y < blocks_.height(); ++y) {
      const std::span<const uint64_t> row = blocks_.row(y);
      for (size_t w = 0; w < row.size(); ++w) {
        if (row[w] == 0) continue;
        const auto first = static_cast<int>(w) * BitRaster::kWordBits;
        x0 = std::min(x0, first + std::countr_zero(row[w]));
        x1 = std::max(x1, first + BitRaster::kWordBits - std::countl_zero(row[w]));
        y0 = std::min(y0, y);
        y1 = y + 1;
      }
    }
    if (y1 == 0) return {};
    return {domain_.x0 + x0 * kBlock_px, domain_.y0 + y0 * kBlock_px, std::min(domain_.x0 + x1 * kBlock_px, domain_.x1),
            std::min(domain_.y0 + y1 * kBlock_px, domain_.y1)};
  }

 private:
  // Calls body(row, columns) for each row of blocks of a rectangle until it returns true.
  template <class Body>
  bool ForRows(const PixelRect& rect, const Body& body) const {
    if (rect.empty()) return false;
    // Rectangles are clipped to the domain.
    const int x0 = (rect.x0 - domain_.x0) / kBlock_px, x1 = (rect.x1 - 1 - domain_.x0) / kBlock_px;
    const int y0 = (rect.y0 - domain_.y0) / kBlock_px, y1 = (rect.y1 - 1 - domain_.y0) / kBlock_px;
    for (int y = y0; y <= y1; ++y) {
      if (body(y, x0, x1 + 1)) return true;
    }
    return false;
  }
  PixelRect domain_;
  BitRaster blocks_;
};

std::vector<uint8_t> FlagsOf(const std::vector<uint32_t>& cells, size_t count) {
  std::vector<uint8_t> flags(count, 0);
  for (const uint32_t cell : cells) flags[cell] = 1;
  return flags;
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
  std::vector<std::vector<BoxPixels>> in_view(views);  // ascending
  std::vector<std::vector<uint32_t>> shown(views);
  std::vector<std::vector<int32_t>> references(views);  // of each view as the other of a pair
  for (const auto& [reference, other] : problem.pairs) references[other].push_back(reference);
  ParallelForEach(views, 1, [&](int64_t v) {
    const CameraWindow& view = problem.views[v];
    in_view[v] = BoxesInWindow(view, problem.boxes, runs, kNearPlane_m);
    const std::vector<uint8_t> is_own = FlagsOf(problem.own[v], cells);
    for (const BoxPixels& own : in_view[v]) {
      if (is_own[own.box]) needed[v].Add(Widened(own.pixels, problem.reference_margin_px, view.rect));
    }
    for (const BoxPixels& other : in_view[v]) {
      if (needed[v].Meets(other.pixels)) shown[v].push_back(other.box);
    }
  });
  VisibleCells visible;
  visible.cells.resize(views);
  visible.windows.resize(views);
  visible.own_windows.resize(views);
  ParallelForEach(views, 1, [&](int64_t v) {
    visible.own_windows[v] = needed[v].Bounds();
    std::vector<uint8_t> lands(cells, 0);
    for (const int32_t reference : references[v]) {
      for (const uint32_t cell : shown[reference]) lands[cell] = 1;
    }
    for (const BoxPixels& landing : in_view[v]) {
      if (!lands[landing.box]) continue;
      needed[v].Add(Widened(landing.pixels, problem.target_margin_px, problem.views[v].rect));
    }
    visible.windows[v] = needed[v].Bounds();
    for (const BoxPixels& other : in_view[v]) {
      if (needed[v].Meets(other.pixels)) visible.cells[v].push_back(other.box);
    }
  });
  visible.own_cells = std::move(shown);
  return visible;
}

}  // namespace tessera
