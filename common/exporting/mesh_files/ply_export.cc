#include "common/exporting/mesh_files/ply_export.h"

#include <functional>

#include "common/exporting/color/vertex_colors.h"
#include "common/exporting/export_map.h"
#include "common/exporting/mesh_files/welded_vertices.h"
#include "common/meshio/ply.h"

namespace tessera {
namespace {

constexpr char kPlyName[] = "mesh.ply";

// Calls visit(index, sheet) for all sheets in order.
Status ForEachPlySheet(const JoinInput& input, const TaskControl& control,
                       const std::function<Status(size_t, const Sheet&)>& visit) {
  for (size_t i = 0; i < input.sheets.size(); ++i) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(static_cast<double>(i) / static_cast<double>(input.sheets.size()), "ply");
    TESSERA_ASSIGN_OR_RETURN(const Sheet sheet, ReadSheet(input.sheets[i].sheet_path));
    TESSERA_RETURN_IF_ERROR(visit(i, sheet));
  }
  return absl::OkStatus();
}

Status AddPlyVertices(const JoinInput& input, const ExportMap& map, const Sheet& sheet, const CityVertices& city,
                      PlyStream* stream) {
  const std::vector<Rgb> colors = VertexColors(sheet, input.scene, input.options.color);
  std::vector<Eigen::Vector3d> positions;
  for (const uint32_t v : city.new_vertices) positions.push_back(sheet.vertices[v]);
  TESSERA_RETURN_IF_ERROR(map.FromLocal(positions));
  for (size_t i = 0; i < positions.size(); ++i) {
    const uint32_t v = city.new_vertices[i];
    // Of a vertex on a border, `sheet` has some of the faces only.
    const bool by_class = input.options.color == VertexColor::kClass;
    stream->AddVertex(positions[i], by_class ? ClassColor(input.scene, city.labels[v]) : colors[v], city.labels[v]);
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<std::vector<std::string>> JoinPly(const JoinInput& input, const std::string& folder,
                                           const TaskControl& control) {
  TESSERA_ASSIGN_OR_RETURN(const ExportMap map, ExportMap::Open(input.scene, input.options.crs));
  WeldedVertices welded;
  PlyLayout layout;
  layout.has_labels = layout.has_confidence = layout.has_vertex_colors = layout.has_vertex_labels = true;
  for (const SceneClass& c : input.scene.classes) layout.label_colors_rgb.push_back(c.color_rgb);
  TESSERA_RETURN_IF_ERROR(ForEachPlySheet(input, PartOf(control, 0, 0.2), [&](size_t, const Sheet& sheet) {
    layout.faces += static_cast<int64_t>(sheet.faces.size());
    layout.has_confidence = layout.has_confidence && sheet.confidence.size() == sheet.faces.size();
    return welded.Add(sheet);
  }));
  layout.vertices = welded.count();
  TESSERA_ASSIGN_OR_RETURN(PlyStream stream, PlyStream::Create(folder + "/" + kPlyName, layout));
  TESSERA_RETURN_IF_ERROR(ForEachPlySheet(input, PartOf(control, 0.2, 0.6), [&](size_t i, const Sheet& sheet) {
    return AddPlyVertices(input, map, sheet, welded.Of(i, sheet), &stream);
  }));
  TESSERA_RETURN_IF_ERROR(ForEachPlySheet(input, PartOf(control, 0.6, 1), [&](size_t i, const Sheet& sheet) {
    const CityVertices city = welded.Of(i, sheet);
    for (size_t f = 0; f < sheet.faces.size(); ++f) {
      PlyFace face;
      for (int k = 0; k < 3; ++k) face.vertices[k] = city.numbers[sheet.faces[f][k]];
      face.label = sheet.labels[f];
      if (layout.has_confidence) face.confidence = sheet.confidence[f];
      stream.AddFace(face);
    }
    return absl::OkStatus();
  }));
  TESSERA_RETURN_IF_ERROR(stream.Finish());
  return std::vector<std::string>{kPlyName};
}

}  // namespace tessera
