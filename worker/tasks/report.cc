#include "worker/tasks/report.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace tessera {
namespace {

using nlohmann::json;

json DisplacementStatistics(const TriangleMesh& before, const TriangleMesh& after) {
  std::vector<double> lengths_m(before.vertices.size());
  double sum_squared = 0;
  for (size_t v = 0; v < lengths_m.size(); ++v) {
    lengths_m[v] = (after.vertices[v] - before.vertices[v]).norm();
    sum_squared += lengths_m[v] * lengths_m[v];
  }
  if (lengths_m.empty()) return json::object();
  std::sort(lengths_m.begin(), lengths_m.end());
  return {{"rms_m", std::sqrt(sum_squared / static_cast<double>(lengths_m.size()))},
          {"median_m", lengths_m[lengths_m.size() / 2]},
          {"p90_m", lengths_m[lengths_m.size() * 9 / 10]},
          {"max_m", lengths_m.back()}};
}

// Share of the area of each class; faces without label under "unlabelled".
json AreaShares(const TriangleMesh& mesh, const std::vector<SceneClass>& classes) {
  std::vector<double> areas(classes.size() + 1, 0.0);
  double total = 0;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const double area = FaceArea(mesh, f);
    const int32_t label = mesh.labels[f];
    areas[label < 0 ? classes.size() : static_cast<size_t>(label)] += area;
    total += area;
  }
  json shares = json::object();
  for (size_t l = 0; l < classes.size(); ++l) shares[classes[l].name] = total > 0 ? areas[l] / total : 0;
  if (areas.back() > 0) shares["unlabelled"] = areas.back() / total;
  return shares;
}

// The tiles' residuals, added up.
json SeamStatistics(const std::vector<json>& tiles) {
  int64_t vertices = 0, faces = 0, label_differences = 0;
  double sum_squared = 0, max_m = 0;
  for (const json& tile : tiles) {
    const json& seam = tile.at("seam");
    vertices += seam.at("vertices").get<int64_t>();
    faces += seam.at("faces").get<int64_t>();
    label_differences += seam.at("label_differences").get<int64_t>();
    sum_squared += seam.at("sum_squared_m2").get<double>();
    max_m = std::max(max_m, seam.at("max_m").get<double>());
  }
  return {{"compared_vertices", vertices},
          {"rms_m", vertices > 0 ? std::sqrt(sum_squared / static_cast<double>(vertices)) : 0},
          {"max_m", max_m},
          {"compared_faces", faces},
          {"label_differences", label_differences}};
}

}  // namespace

std::string MakeReport(const Survey& survey, const TriangleMesh& before, const TriangleMesh& after,
                       const std::vector<ReportedTile>& tiles) {
  std::vector<json> tile_reports;
  for (const ReportedTile& tile : tiles) {
    tile_reports.push_back(json::parse(tile.report));
    tile_reports.back()["tile"] = tile.tile;
  }
  int64_t label_changes = 0;
  for (size_t f = 0; f < before.labels.size(); ++f) label_changes += before.labels[f] != after.labels[f];
  json class_names = json::array();
  for (const SceneClass& c : survey.classes) class_names.push_back(c.name);
  return json{{"scene", survey.scene_name},
              {"gsd_m", survey.gsd_m},
              {"views", survey.views.size()},
              {"classes", class_names},
              {"input", {{"vertices", survey.input_vertices}, {"faces", survey.input_faces}}},
              {"output", {{"vertices", after.vertices.size()}, {"faces", after.faces.size()}}},
              {"displacement", DisplacementStatistics(before, after)},
              {"label_changes", label_changes},
              {"area_share_before", AreaShares(before, survey.classes)},
              {"area_share_after", AreaShares(after, survey.classes)},
              {"seam", SeamStatistics(tile_reports)},
              {"tiles", tile_reports},
              {"warnings", survey.warnings}}
             .dump(2) +
         "\n";
}

}  // namespace tessera
