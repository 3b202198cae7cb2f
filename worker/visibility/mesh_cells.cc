#include "worker/visibility/mesh_cells.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <span>

#include "common/base/parallel.h"
#include "worker/visibility/box_kernel.h"

namespace tessera {
namespace {

constexpr int64_t kCellGrain = 16;

void Append(uint32_t begin, uint32_t end, std::vector<std::array<uint32_t, 2>>* ranges) {
  if (begin == end) return;
  if (!ranges->empty() && ranges->back()[1] == begin) {
    ranges->back()[1] = end;
  } else {
    ranges->push_back({begin, end});
  }
}

}  // namespace

void ForRanges(const std::vector<std::array<uint32_t, 2>>& ranges, int64_t grain,
               const std::function<void(int64_t, int64_t)>& body) {
  // Each part has about `grain` elements of one or several ranges.
  std::vector<std::array<int64_t, 2>> pieces;
  std::vector<size_t> parts = {0};
  int64_t in_part = 0;
  for (const auto& [first, last] : ranges) {
    for (int64_t begin = first; begin < last;) {
      const int64_t end = std::min<int64_t>(last, begin + grain - in_part);
      pieces.push_back({begin, end});
      in_part += end - begin;
      begin = end;
      if (in_part < grain) continue;
      parts.push_back(pieces.size());
      in_part = 0;
    }
  }
  if (in_part > 0) parts.push_back(pieces.size());
  ParallelForEach(parts.size() - 1, 1, [&](size_t part) {
    for (size_t i = parts[part]; i < parts[part + 1]; ++i) body(pieces[i][0], pieces[i][1]);
  });
}

void FindVertexCells(const std::vector<Triangle>& faces, MeshCells* cells) {
  const size_t count = cells->face_begin.empty() ? 0 : cells->face_begin.size() - 1;
  cells->vertex_cells.assign(count, {});
  ParallelForEach(count, kCellGrain, [&](int64_t c) {
    std::vector<uint32_t>& used = cells->vertex_cells[c];
    for (uint32_t f = cells->face_begin[c]; f < cells->face_begin[c + 1]; ++f) {
      for (const uint32_t v : faces[f]) {
        // Several cells may begin at v (empty ones): the last of them contains it.
        const auto next = std::upper_bound(cells->vertex_begin.begin(), cells->vertex_begin.end(), v);
        const auto cell = static_cast<uint32_t>(next - cells->vertex_begin.begin() - 1);
        if (std::find(used.begin(), used.end(), cell) == used.end()) used.push_back(cell);
      }
    }
    std::sort(used.begin(), used.end());
  });
}

std::vector<Eigen::AlignedBox3d> RunsOf(const std::vector<Eigen::AlignedBox3d>& boxes) {
  std::vector<Eigen::AlignedBox3d> runs((boxes.size() + kRunCells - 1) / kRunCells);
  for (size_t c = 0; c < boxes.size(); ++c) runs[c / kRunCells].extend(boxes[c]);
  return runs;
}

std::vector<BoxPixels> BoxesInWindow(const CameraWindow& window, const std::vector<Eigen::AlignedBox3d>& boxes,
                                     const std::vector<Eigen::AlignedBox3d>& runs, double near_m) {
  std::vector<PixelRect> of_runs(runs.size());
  BoundPixels(window, runs, near_m, of_runs);
  std::vector<BoxPixels> in_window;
  std::array<PixelRect, kRunCells> pixels;
  for (size_t run = 0; run < runs.size(); ++run) {
    if (of_runs[run].empty()) continue;
    const size_t first = run * kRunCells, count = std::min(kRunCells, boxes.size() - first);
    BoundPixels(window, std::span(boxes).subspan(first, count), near_m, pixels);
    for (size_t i = 0; i < count; ++i) {
      if (!pixels[i].empty()) in_window.push_back({static_cast<uint32_t>(first + i), pixels[i]});
    }
  }
  return in_window;
}

CellBoxes::CellBoxes(const TriangleMesh& mesh, const MeshCells* cells)
    : cells_(cells), boxes_(cells == nullptr ? 0 : cells->size()) {
  all_.faces = {{0, static_cast<uint32_t>(mesh.faces.size())}};
  all_.vertices = {{0, static_cast<uint32_t>(mesh.vertices.size())}};
  ParallelForEach(boxes_.size(), kCellGrain, [&](int64_t c) {
    for (uint32_t f = cells_->face_begin[c]; f < cells_->face_begin[c + 1]; ++f) {
      for (const uint32_t v : mesh.faces[f]) boxes_[c].extend(mesh.vertices[v]);
    }
  });
  runs_ = RunsOf(boxes_);
}

MeshPart CellBoxes::InWindow(const CameraWindow& window, double near_m) const {
  if (boxes_.empty()) return all_;
  std::vector<uint32_t> cells;
  for (const BoxPixels& in_window : BoxesInWindow(window, boxes_, runs_, near_m)) cells.push_back(in_window.box);
  return PartOf(cells);
}

MeshPart CellBoxes::PartOf(const std::vector<uint32_t>& cells) const {
  MeshPart part;
  std::vector<uint8_t> used(boxes_.size(), 0);
  for (const uint32_t c : cells) {
    Append(cells_->face_begin[c], cells_->face_begin[c + 1], &part.faces);
    for (const uint32_t v : cells_->vertex_cells[c]) used[v] = 1;
  }
  for (size_t c = 0; c < used.size(); ++c) {
    const void* const next = std::memchr(&used[c], 1, used.size() - c);  // few of them are used
    if (next == nullptr) break;
    c = static_cast<size_t>(static_cast<const uint8_t*>(next) - used.data());
    Append(cells_->vertex_begin[c], cells_->vertex_begin[c + 1], &part.vertices);
  }
  return part;
}

}  // namespace tessera
