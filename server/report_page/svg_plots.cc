#include "server/report_page/svg_plots.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/base/printable.h"
#include "server/client/job_text.h"

namespace tessera {
namespace {

constexpr double kWidth = 460;  // of a plot, in units of its view box: pixels of a phone

std::string Coordinate(double value) { return absl::StrFormat("%.1f", std::isfinite(value) ? value : 0.0); }

Html PlotText(double x, double y, const std::string& anchor, const std::string& style, const std::string& text) {
  return HtmlElement("text", {{"x", Coordinate(x)}, {"y", Coordinate(y)}, {"text-anchor", anchor}, {"class", style}},
                     HtmlText(text));
}

Html PlotRect(double x, double y, double width, double height, HtmlAttributes attributes, const std::string& tooltip) {
  attributes.insert(attributes.end(), {{"x", Coordinate(x)},
                                       {"y", Coordinate(y)},
                                       {"width", Coordinate(std::max(width, 0.0))},
                                       {"height", Coordinate(std::max(height, 0.0))}});
  return HtmlElement("rect", attributes, tooltip.empty() ? Html() : HtmlElement("title", HtmlText(tooltip)));
}

Html PlotLine(double x0, double y0, double x1, double y1, const std::string& style) {
  return HtmlElement("line", {{"x1", Coordinate(x0)},
                              {"y1", Coordinate(y0)},
                              {"x2", Coordinate(x1)},
                              {"y2", Coordinate(y1)},
                              {"class", style}});
}

Html Svg(const std::string& title, double height, const Html& content) {
  return HtmlElement("svg",
                     {{"xmlns", "http://www.w3.org/2000/svg"},
                      {"viewBox", absl::StrCat("0 0 ", Coordinate(kWidth), " ", Coordinate(height))},
                      {"role", "img"},
                      {"aria-label", title}},
                     content);
}

// Ticks at a step of 1, 2 or 5 times a power of ten that cover low..high with at most `most` steps.
std::vector<double> Ticks(double low, double high, int most) {
  const double step = NiceCeiling(std::max((high - low) / most, 1e-300));
  std::vector<double> ticks;
  for (double at = std::floor(low / step); at <= std::ceil(high / step) && ticks.size() < 20; ++at) {
    ticks.push_back(at * step);
  }
  return ticks;
}

}  // namespace

std::string PlotNumber(double value) {
  if (!std::isfinite(value)) return "\xe2\x80\x93";  // an en dash
  const double size = std::abs(value);
  if (size >= 1000 && size < 1e15) return FormatThousands(std::llround(value));
  if (size >= 100 && size < 1000) return absl::StrFormat("%.0f", value);
  return absl::StrFormat("%.3g", size < 1e-12 ? 0.0 : value);
}

std::string HexColor(const std::array<uint8_t, 3>& color_rgb) {
  return absl::StrFormat("#%02x%02x%02x", color_rgb[0], color_rgb[1], color_rgb[2]);
}

double NiceCeiling(double value) {
  if (!(value > 0) || !std::isfinite(value)) return 1;
  const double power = std::pow(10.0, std::floor(std::log10(value)));
  for (const double step : {1.0, 2.0, 5.0}) {
    if (value <= step * power * (1 + 1e-9)) return step * power;
  }
  return 10 * power;
}

Html ToSvg(const LinePlot& plot) {
  constexpr double kHeight = 240, kLeft = 54, kRight = kWidth - 26, kTop = 18, kBottom = kHeight - 42;
  double low = INFINITY, high = -INFINITY;
  for (const LinePlot::Line& line : plot.lines) {
    for (const double value : line.values) {
      low = std::min(low, value);
      high = std::max(high, value);
    }
  }
  if (!std::isfinite(low) || !std::isfinite(high) || plot.positions.empty()) return {};
  const double margin = std::max({0.12 * (high - low), 1e-3 * std::abs(high), 1e-12});
  const std::vector<double> ticks = Ticks(low - margin, high + margin, 5);
  const double y_low = ticks.front(), y_high = ticks.back();
  const size_t count = plot.positions.size();
  const auto x_of = [&](size_t i) {
    return kLeft + 26 +
           (kRight - kLeft - 52) * (count > 1 ? static_cast<double>(i) / static_cast<double>(count - 1) : 0.5);
  };
  const auto y_of = [&](double value) { return kBottom - (kBottom - kTop) * (value - y_low) / (y_high - y_low); };
  Html content;
  for (const double tick : ticks) {
    content += PlotLine(kLeft, y_of(tick), kRight, y_of(tick), "grid");
    content += PlotText(kLeft - 6, y_of(tick) + 4, "end", "tick", PlotNumber(tick));
  }
  for (size_t i = 0; i < count; ++i) {
    // Two words stand below each other.
    const std::string& name = plot.positions[i];
    const size_t gap = name.find('\n');
    content += PlotText(x_of(i), kBottom + 17, "middle", "tick", name.substr(0, gap));
    if (gap != std::string::npos) content += PlotText(x_of(i), kBottom + 31, "middle", "tick", name.substr(gap + 1));
  }
  for (const LinePlot::Line& line : plot.lines) {
    std::string points;
    for (size_t i = 0; i < std::min(line.values.size(), count); ++i) {
      absl::StrAppend(&points, i == 0 ? "" : " ", Coordinate(x_of(i)), ",", Coordinate(y_of(line.values[i])));
    }
    content += HtmlElement("polyline", {{"points", points}, {"class", line.main ? "line" : "thin"}},
                           HtmlElement("title", HtmlText(line.name)));
    if (!line.main) continue;
    for (size_t i = 0; i < std::min(line.values.size(), count); ++i) {
      content += HtmlElement(
          "circle",
          {{"cx", Coordinate(x_of(i))}, {"cy", Coordinate(y_of(line.values[i]))}, {"r", "3.5"}, {"class", "used"}});
      content +=
          PlotText(x_of(i), y_of(line.values[i]) - 9, "middle", "value", absl::StrFormat("%.4g", line.values[i]));
    }
  }
  return Svg(plot.title, kHeight, content);
}

Html ToSvg(const BarPlot& plot) {
  constexpr double kRow = 30, kBar = 18, kLeft = 96, kRight = kWidth - 134;
  if (plot.rows.empty()) return {};
  double largest = 0;
  for (const BarPlot::Row& row : plot.rows) largest = std::max({largest, row.value, row.compared.value_or(0)});
  const auto length_of = [&](double value) {
    return largest > 0 && std::isfinite(value) ? (kRight - kLeft) * std::max(value, 0.0) / largest : 0;
  };
  Html content;
  double y = 6;
  for (const BarPlot::Row& row : plot.rows) {
    // A class with a long name must not run into its bar.
    const bool is_long = row.name.size() > 14;
    content += PlotText(kLeft - 8, y + 14, "end", "name", is_long ? std::string(Prefix(row.name, 13)) + "." : row.name);
    if (row.compared) {
      HtmlAttributes pale = {{"class", "compared"}};
      if (row.color_rgb) pale = {{"fill", HexColor(*row.color_rgb)}, {"fill-opacity", "0.35"}};
      content += PlotRect(kLeft, y, length_of(*row.compared), kBar, pale,
                          absl::StrCat(plot.compared_name, ": ", PlotNumber(*row.compared)));
    }
    const double inset = row.compared ? 4 : 0;
    content +=
        PlotRect(kLeft, y + inset, length_of(row.value), kBar - 2 * inset,
                 row.color_rgb ? HtmlAttributes{{"fill", HexColor(*row.color_rgb)}} : HtmlAttributes{{"class", "used"}},
                 absl::StrCat(row.name, ": ", PlotNumber(row.value)));
    content += PlotText(kLeft + std::max(length_of(row.value), length_of(row.compared.value_or(0))) + 7, y + 14,
                        "start", "value", row.text);
    y += kRow;
  }
  if (!plot.value_name.empty()) {
    content += PlotRect(kLeft, y + 3, 12, 8, {{"class", plot.rows.front().color_rgb ? "neutral" : "used"}}, "");
    content += PlotText(kLeft + 18, y + 11, "start", "tick", plot.value_name);
    const double second = kLeft + 40 + 7.0 * static_cast<double>(plot.value_name.size());
    content += PlotRect(second, y, 12, 14, {{"class", plot.rows.front().color_rgb ? "neutral pale" : "compared"}}, "");
    content += PlotText(second + 18, y + 11, "start", "tick", plot.compared_name);
    y += 20;
  }
  return Svg(plot.title, y, content);
}

Html ToSvg(const HistogramPlot& plot) {
  constexpr double kHeight = 220, kLeft = 46, kRight = kWidth - 14, kTop = 12, kBottom = kHeight - 42;
  const size_t count = plot.shares.size();
  const double largest = count > 0 ? *std::max_element(plot.shares.begin(), plot.shares.end()) : 0;
  if (!(largest > 0) || !(plot.high > plot.low)) return {};
  const std::vector<double> ticks = Ticks(0, largest, 4);
  const double step = (kRight - kLeft) / static_cast<double>(count);
  const auto y_of = [&](double share) { return kBottom - (kBottom - kTop) * share / ticks.back(); };
  const auto x_of = [&](double value) {
    return kLeft + (kRight - kLeft) * (value - plot.low) / (plot.high - plot.low);
  };
  Html content;
  for (const double tick : ticks) {
    content += PlotLine(kLeft, y_of(tick), kRight, y_of(tick), "grid");
    content += PlotText(kLeft - 6, y_of(tick) + 4, "end", "tick", absl::StrFormat("%.4g %%", 100 * tick));
  }
  for (size_t i = 0; i < count; ++i) {
    const double from = plot.low + (plot.high - plot.low) * static_cast<double>(i) / static_cast<double>(count);
    const double to = plot.low + (plot.high - plot.low) * static_cast<double>(i + 1) / static_cast<double>(count);
    content += PlotRect(
        kLeft + step * static_cast<double>(i) + 0.5, y_of(plot.shares[i]), step - 1, kBottom - y_of(plot.shares[i]),
        {{"class", "used"}},
        absl::StrCat(PlotNumber(from), " to ", PlotNumber(to), ": ", absl::StrFormat("%.2f %%", 100 * plot.shares[i])));
  }
  for (const double tick : Ticks(plot.low, plot.high, 6)) {
    if (tick < plot.low - 1e-9 * (plot.high - plot.low) || tick > plot.high + 1e-9 * (plot.high - plot.low)) continue;
    content += PlotText(x_of(tick), kBottom + 17, "middle", "tick", PlotNumber(tick));
  }
  content += PlotText(0.5 * (kLeft + kRight), kBottom + 35, "middle", "tick", plot.axis);
  return Svg(plot.title, kHeight, content);
}

}  // namespace tessera
