// Colours of the vertices of a sheet, and what they mean.
#pragma once

#include <string>
#include <vector>

#include "common/exporting/export_format.h"
#include "common/exporting/export_scene.h"
#include "common/exporting/sheet.h"

namespace tessera {

// Of faces without a label, and of vertices whose value is not known.
inline constexpr Rgb kUnknownColor = {160, 160, 160};

// The end of the colour scale of displacements, in GSD. It is fixed, so that sheets and jobs can be compared.
inline constexpr double kDisplacementScale_gsd = 10;

// The colour of the class; kUnknownColor for -1 and other labels that are no classes of the scene.
Rgb ClassColor(const ExportScene& scene, int32_t label);

// viridis (matplotlib) from 0, dark blue, to 1, yellow; values are clamped.
Rgb ConfidenceRgb(double confidence);

// YlOrRd (ColorBrewer) from 0, pale yellow, to kDisplacementScale_gsd, dark red; values are clamped.
Rgb DisplacementRgb(double displacement_m, double gsd_m);

// Per vertex: the class with the largest area of the faces around it, the lower one of equal ones; -1 counts as a
// class. -1 without faces.
std::vector<int32_t> VertexLabels(const Sheet& sheet);

// Per vertex. kClass: of VertexLabels. kConfidence: of the mean of the faces around it, by area. kImage: Sheet::colors.
// kUnknownColor where the sheet lacks the values.
std::vector<Rgb> VertexColors(const Sheet& sheet, const ExportScene& scene, VertexColor color);

struct LegendEntry {
  std::string name;  // a class, as the scene names it; or a value with its unit: "0.25", "5 m"
  Rgb color;
  bool operator==(const LegendEntry&) const = default;
};

// What the colours mean: the classes; or five values of a scale, between which colours are interpolated. Empty for
// kImage.
std::vector<LegendEntry> ColorLegend(const ExportScene& scene, VertexColor color);

}  // namespace tessera
