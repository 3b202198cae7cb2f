// Plots as inline SVG. Their colours come from classes of the page's style sheet (report_style.h), so that they follow
// the reader's light or dark theme.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "server/report_page/html_writer.h"

namespace tessera {

// "0.617", "12,345", "1.2e-05": three significant digits, or all digits of a larger whole number.
std::string PlotNumber(double value);

// "#rrggbb".
std::string HexColor(const std::array<uint8_t, 3>& color_rgb);

// 1, 2 or 5 times a power of ten that is not less than `value` (> 0).
double NiceCeiling(double value);

// Lines over positions with names.
struct LinePlot {
  struct Line {
    std::string name;
    std::vector<double> values;  // one per position
    bool main = true;            // false: thin, without numbers
  };
  std::string title;  // for screen readers
  std::vector<std::string> positions;
  std::vector<Line> lines;
};
Html ToSvg(const LinePlot& plot);

// Horizontal bars, each with an optional second value to compare with, drawn as a pale bar behind it.
struct BarPlot {
  struct Row {
    std::string name;
    double value = 0;
    std::optional<double> compared;
    std::string text;                                      // at the end of the bar
    std::optional<std::array<uint8_t, 3>> color_rgb = {};  // none: the page's accent
  };
  std::string title;
  std::string value_name, compared_name;  // of the legend; both empty: no legend
  std::vector<Row> rows;
};
Html ToSvg(const BarPlot& plot);

// Shares of equal intervals.
struct HistogramPlot {
  std::string title;
  double low = 0, high = 1;
  std::vector<double> shares;
  std::string axis;  // what the values are, with their unit
};
Html ToSvg(const HistogramPlot& plot);

}  // namespace tessera
