#include "worker/visibility/mesh_cells.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int64_t kCellGrain = 16;
constexpr int kRounding_px = 2;  // error bound of projected corners and of the rasteriser's grid

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

PixelRect PixelsOf(const CameraWindow& view, const Eigen::AlignedBox3d& box, double near_m, int margin_px) {
  if (box.isEmpty()) return {};
  const PixelRect& domain = view.rect;
  double x0 = 1e300, y0 = 1e300, x1 = -1e300, y1 = -1e300;
  int behind = 0;
  const PinholeCamera& k = view.camera.intrinsics;
  const Eigen::Vector3d lowest = view.camera.CameraFromWorld(box.min());
  const Eigen::Matrix3d edges = view.camera.rotation_cam_from_world * box.sizes().asDiagonal();
  for (int c = 0; c < 8; ++c) {
    Eigen::Vector3d p = lowest;
    for (int axis = 0; axis < 3; ++axis) {
      if (c >> axis & 1) p += edges.col(axis);
    }
    if (!(p.z() >= near_m)) {
      ++behind;
      continue;
    }
    const double scale = 1 / p.z(), x = k.fx * scale * p.x() + k.cx, y = k.fy * scale * p.y() + k.cy;
    x0 = std::min(x0, x);
    x1 = std::max(x1, x);
    y0 = std::min(y0, y);
    y1 = std::max(y1, y);
  }
  if (behind == 8) return {};
  if (behind > 0) return domain;
  const int margin = margin_px + kRounding_px;
  const auto clip = [](double x, int low, int high) {
    return static_cast<int>(std::clamp(x, static_cast<double>(low), static_cast<double>(high)));
  };
  return {clip(std::floor(x0 - margin), domain.x0, domain.x1), clip(std::floor(y0 - margin), domain.y0, domain.y1),
          clip(std::ceil(x1 + margin), domain.x0, domain.x1), clip(std::ceil(y1 + margin), domain.y0, domain.y1)};
}

std::vector<Eigen::AlignedBox3d> RunsOf(const std::vector<Eigen::AlignedBox3d>& boxes) {
  std::vector<Eigen::AlignedBox3d> runs((boxes.size() + kRunCells - 1) / kRunCells);
  for (size_t c = 0; c < boxes.size(); ++c) runs[c / kRunCells].extend(boxes[c]);
  return runs;
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
  for (size_t run = 0; run < runs_.size(); ++run) {
    if (PixelsOf(window, runs_[run], near_m, 0).empty()) continue;
    for (size_t c = run * kRunCells; c < std::min(boxes_.size(), (run + 1) * kRunCells); ++c) {
      if (!PixelsOf(window, boxes_[c], near_m, 0).empty()) cells.push_back(static_cast<uint32_t>(c));
    }
  }
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
