#include "worker/city/collected_faces.h"

#include <algorithm>

namespace tessera {

namespace {

// The indices of items in the order of their ids.
template <class Item>
std::vector<uint32_t> ById(const std::vector<Item>& items) {
  std::vector<uint64_t> keys(items.size());  // id, index
  for (size_t i = 0; i < items.size(); ++i) keys[i] = static_cast<uint64_t>(items[i].id) << 32 | i;
  std::sort(keys.begin(), keys.end());
  std::vector<uint32_t> order(items.size());
  for (size_t i = 0; i < keys.size(); ++i) order[i] = static_cast<uint32_t>(keys[i]);
  return order;
}

}  // namespace

void FaceCollector::Add(const CityBlock& block, size_t face) {
  if (block_ != block.vertex_ids.data()) {
    block_ = block.vertex_ids.data();
    place_.assign(block.vertex_ids.size(), kNone);
  }
  Face& added = faces_.emplace_back(Face{block.face_ids[face], block.mesh.labels[face], {}});
  for (int k = 0; k < 3; ++k) {
    const uint32_t v = block.mesh.faces[face][k];
    if (place_[v] == kNone) {
      place_[v] = static_cast<uint32_t>(vertices_.size());
      vertices_.push_back({block.vertex_ids[v], block.mesh.vertices[v]});
    }
    added.vertices[k] = place_[v];
  }
}

CollectedFaces FaceCollector::Finish() {
  CollectedFaces out;
  std::vector<uint32_t> index(vertices_.size());  // in `out`
  for (const uint32_t v : ById(vertices_)) {
    if (out.vertex_ids.empty() || out.vertex_ids.back() != vertices_[v].id) {  // else a vertex of two blocks
      out.vertex_ids.push_back(vertices_[v].id);
      out.mesh.vertices.push_back(vertices_[v].position);
    }
    index[v] = static_cast<uint32_t>(out.vertex_ids.size() - 1);
  }
  vertices_ = {};
  out.face_ids.reserve(faces_.size());
  out.mesh.faces.reserve(faces_.size());
  out.mesh.labels.reserve(faces_.size());
  for (const uint32_t f : ById(faces_)) {
    const auto& [a, b, c] = faces_[f].vertices;
    out.face_ids.push_back(faces_[f].id);
    out.mesh.faces.push_back({index[a], index[b], index[c]});
    out.mesh.labels.push_back(faces_[f].label);
  }
  faces_ = {};
  block_ = nullptr;
  return out;
}

StatusOr<CollectedFaces> CollectCells(const CityReader& city, const GroundPlane& ground, const CellRect& rect,
                                      const TaskControl& control) {
  FaceCollector collector;
  for (size_t b = 0; b < city.block_count(); ++b) {
    const CellRect& cells = city.cells(b);
    if (cells.x0 >= rect.x1 || rect.x0 >= cells.x1 || cells.y0 >= rect.y1 || rect.y0 >= cells.y1) continue;
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(static_cast<double>(b) / static_cast<double>(city.block_count()), "reading the city");
    TESSERA_ASSIGN_OR_RETURN(const CityBlock block, city.Block(b));
    for (size_t f = 0; f < block.face_ids.size(); ++f) {
      if (rect.Contains(ground.Cell(block.mesh.Centroid(f)))) collector.Add(block, f);
    }
  }
  return collector.Finish();
}

}  // namespace tessera
