#include "common/exporting/color/vertex_colors.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tuple>

#include "absl/strings/str_format.h"

namespace tessera {
namespace {

using ColorScale = std::array<Rgb, 9>;  // at equal distances

constexpr ColorScale kViridis = {{{68, 1, 84},
                                  {71, 45, 123},
                                  {59, 82, 139},
                                  {44, 114, 142},
                                  {33, 144, 140},
                                  {39, 173, 129},
                                  {93, 200, 99},
                                  {170, 220, 50},
                                  {253, 231, 37}}};
constexpr ColorScale kYlOrRd = {{{255, 255, 204},
                                 {255, 237, 160},
                                 {254, 217, 118},
                                 {254, 178, 76},
                                 {253, 141, 60},
                                 {252, 78, 42},
                                 {227, 26, 28},
                                 {189, 0, 38},
                                 {128, 0, 38}}};

// The colour at `value` in [0, 1].
Rgb ScaleColorAt(const ColorScale& scale, double value) {
  if (!std::isfinite(value)) return kUnknownColor;
  const double at = std::clamp(value, 0.0, 1.0) * (scale.size() - 1);
  const size_t i = std::min(static_cast<size_t>(at), scale.size() - 2);
  Rgb color;
  for (int c = 0; c < 3; ++c) {
    color[c] = static_cast<uint8_t>(
        std::lround(scale[i][c] + (at - static_cast<double>(i)) * (scale[i + 1][c] - scale[i][c])));
  }
  return color;
}

// Mean of the confidence of the faces around each vertex, by area; NaN without any.
std::vector<double> VertexConfidence(const Sheet& sheet) {
  std::vector<double> sums(sheet.vertices.size()), areas(sheet.vertices.size());
  const MeshSpans mesh = sheet.mesh();
  for (size_t f = 0; f < sheet.faces.size(); ++f) {
    const double area = FaceArea(mesh, f);
    for (const uint32_t v : sheet.faces[f]) {
      sums[v] += area * sheet.confidence[f];
      areas[v] += area;
    }
  }
  for (size_t v = 0; v < sums.size(); ++v) {
    sums[v] = areas[v] > 0 ? sums[v] / areas[v] : std::numeric_limits<double>::quiet_NaN();
  }
  return sums;
}

}  // namespace

Rgb ClassColor(const ExportScene& scene, int32_t label) {
  return label >= 0 && static_cast<size_t>(label) < scene.classes.size() ? scene.classes[label].color_rgb
                                                                         : kUnknownColor;
}

Rgb ConfidenceRgb(double confidence) { return ScaleColorAt(kViridis, confidence); }

Rgb DisplacementRgb(double displacement_m, double gsd_m) {
  return ScaleColorAt(kYlOrRd, displacement_m / (kDisplacementScale_gsd * gsd_m));
}

std::vector<int32_t> VertexLabels(const Sheet& sheet) {
  std::vector<int32_t> labels(sheet.vertices.size(), -1);
  std::vector<uint8_t> faces(labels.size());  // 0: none yet, 1: of one label, 2: of several labels
  for (size_t f = 0; f < sheet.faces.size(); ++f) {
    for (const uint32_t v : sheet.faces[f]) {
      if (faces[v] == 0) labels[v] = sheet.labels[f];
      faces[v] = faces[v] == 0 || (faces[v] == 1 && labels[v] == sheet.labels[f]) ? 1 : 2;
    }
  }
  struct Part {
    uint32_t vertex;
    int32_t label;
    double area;
  };
  std::vector<Part> parts;  // of the vertices of several labels
  const MeshSpans mesh = sheet.mesh();
  for (size_t f = 0; f < sheet.faces.size(); ++f) {
    for (const uint32_t v : sheet.faces[f]) {
      if (faces[v] == 2) parts.push_back({v, sheet.labels[f], FaceArea(mesh, f)});
    }
  }
  std::stable_sort(parts.begin(), parts.end(), [](const Part& a, const Part& b) {
    return std::tie(a.vertex, a.label) < std::tie(b.vertex, b.label);
  });
  double largest = -1;
  for (size_t i = 0; i < parts.size();) {
    const Part& part = parts[i];
    if (i == 0 || parts[i - 1].vertex != part.vertex) largest = -1;
    double area = 0;
    for (; i < parts.size() && parts[i].vertex == part.vertex && parts[i].label == part.label; ++i) {
      area += parts[i].area;
    }
    if (area <= largest) continue;
    largest = area;
    labels[part.vertex] = part.label;
  }
  return labels;
}

std::vector<Rgb> VertexColors(const Sheet& sheet, const ExportScene& scene, VertexColor color) {
  std::vector<Rgb> colors(sheet.vertices.size(), kUnknownColor);
  if (color == VertexColor::kClass) {
    const std::vector<int32_t> labels = VertexLabels(sheet);
    for (size_t v = 0; v < colors.size(); ++v) colors[v] = ClassColor(scene, labels[v]);
  } else if (color == VertexColor::kImage) {
    if (!sheet.colors.empty()) colors = sheet.colors;
  } else if (color == VertexColor::kConfidence && !sheet.confidence.empty()) {
    const std::vector<double> confidence = VertexConfidence(sheet);
    for (size_t v = 0; v < colors.size(); ++v) colors[v] = ConfidenceRgb(confidence[v]);
  } else if (color == VertexColor::kDisplacement && !sheet.displacement_m.empty()) {
    for (size_t v = 0; v < colors.size(); ++v) colors[v] = DisplacementRgb(sheet.displacement_m[v], scene.gsd_m);
  }
  return colors;
}

std::vector<LegendEntry> ColorLegend(const ExportScene& scene, VertexColor color) {
  std::vector<LegendEntry> legend;
  if (color == VertexColor::kClass) {
    for (const SceneClass& c : scene.classes) legend.push_back({c.name, c.color_rgb});
  }
  if (color != VertexColor::kConfidence && color != VertexColor::kDisplacement) return legend;
  for (int i = 0; i <= 4; ++i) {
    if (color == VertexColor::kConfidence) {
      legend.push_back({absl::StrFormat("%g", 0.25 * i), ConfidenceRgb(0.25 * i)});
    } else {
      const double displacement_m = 0.25 * i * kDisplacementScale_gsd * scene.gsd_m;
      legend.push_back({absl::StrFormat("%.3g m", displacement_m), DisplacementRgb(displacement_m, scene.gsd_m)});
    }
  }
  return legend;
}

}  // namespace tessera
