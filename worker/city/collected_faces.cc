#include "worker/city/collected_faces.h"

#include <algorithm>

namespace tessera {

void FaceCollector::Add(const CityBlock& block, size_t face) {
  if (block_ != block.vertex_ids.data()) {
    block_ = block.vertex_ids.data();
    taken_.assign(block.vertex_ids.size(), 0);
  }
  for (const uint32_t v : block.mesh.faces[face]) {
    if (taken_[v]) continue;
    taken_[v] = 1;
    vertices_.emplace_back(block.vertex_ids[v], block.mesh.vertices[v]);
  }
  faces_.push_back({block.face_ids[face], block.GlobalFace(face), block.mesh.labels[face]});
}

CollectedFaces FaceCollector::Finish() {
  CollectedFaces out;
  std::sort(vertices_.begin(), vertices_.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  for (const auto& [id, position] : vertices_) {
    if (!out.vertex_ids.empty() && out.vertex_ids.back() == id) continue;  // a vertex of two blocks
    out.vertex_ids.push_back(id);
    out.mesh.vertices.push_back(position);
  }
  vertices_ = {};
  std::sort(faces_.begin(), faces_.end(), [](const Picked& a, const Picked& b) { return a.id < b.id; });
  for (const Picked& face : faces_) {
    Triangle& local = out.mesh.faces.emplace_back();
    for (int k = 0; k < 3; ++k) {
      local[k] = static_cast<uint32_t>(
          std::lower_bound(out.vertex_ids.begin(), out.vertex_ids.end(), face.vertices[k]) - out.vertex_ids.begin());
    }
    out.face_ids.push_back(face.id);
    out.mesh.labels.push_back(face.label);
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
