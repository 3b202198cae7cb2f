#include "common/exporting/mesh_files/welded_vertices.h"

#include <limits>

#include "common/exporting/color/vertex_colors.h"
#include "common/exporting/sheet_border.h"

namespace tessera {

Status WeldedVertices::Add(const Sheet& sheet) {
  if (count_ + static_cast<int64_t>(sheet.vertices.size()) > std::numeric_limits<uint32_t>::max()) {
    return absl::ResourceExhaustedError("the mesh has more than 4,294,967,295 vertices: export it as 3dtiles or obj");
  }
  const std::vector<uint8_t> is_border = BorderVertices(sheet.vertices.size(), sheet.faces);
  first_new_.push_back(static_cast<uint32_t>(count_));
  for (size_t v = 0; v < sheet.vertices.size(); ++v) {
    if (is_border[v] != 0 && positions_.NumberOf(sheet.vertices[v]) < borders_.size()) continue;
    if (is_border[v] != 0) borders_.push_back({static_cast<uint32_t>(count_)});
    ++count_;
  }
  const MeshSpans mesh = sheet.mesh();
  for (size_t f = 0; f < sheet.faces.size(); ++f) {
    for (const uint32_t v : sheet.faces[f]) {
      if (is_border[v] == 0) continue;
      const uint32_t index = positions_.NumberOf(sheet.vertices[v]);
      Border& border = borders_[index];
      const double area = FaceArea(mesh, f);
      if (border.area < 0) {
        border.label = sheet.labels[f];
        border.area = area;
      } else if (border.label == sheet.labels[f]) {
        border.area += area;
      } else {
        other_areas_[{index, sheet.labels[f]}] += area;
      }
    }
  }
  return absl::OkStatus();
}

CityVertices WeldedVertices::Of(size_t index, const Sheet& sheet) {
  CityVertices vertices;
  vertices.labels = VertexLabels(sheet);
  const std::vector<uint8_t> is_border = BorderVertices(sheet.vertices.size(), sheet.faces);
  uint32_t next = first_new_[index];
  for (uint32_t v = 0; v < sheet.vertices.size(); ++v) {
    if (is_border[v] == 0) {
      vertices.new_vertices.push_back(v);
      vertices.numbers.push_back(next++);
      continue;
    }
    const uint32_t at = positions_.NumberOf(sheet.vertices[v]);
    const Border& border = borders_[at];
    vertices.numbers.push_back(border.number);
    if (border.number == next) {
      vertices.new_vertices.push_back(v);
      ++next;
    }
    std::pair<double, int32_t> most = {border.area, border.label};
    for (auto it = other_areas_.lower_bound({at, std::numeric_limits<int32_t>::min()});
         it != other_areas_.end() && it->first.first == at; ++it) {
      const std::pair<double, int32_t> other = {it->second, it->first.second};
      if (other.first > most.first || (other.first == most.first && other.second < most.second)) most = other;
    }
    vertices.labels[v] = most.second;
  }
  return vertices;
}

}  // namespace tessera
