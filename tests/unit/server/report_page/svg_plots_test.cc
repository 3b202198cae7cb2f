#include "server/report_page/svg_plots.h"

#include <gmock/gmock.h>

#include <cmath>
#include <sstream>

#include "tests/unit/server/report_page/page_fixtures.h"

namespace tessera {
namespace {

using testing::HasSubstr;

pugi::xml_document Parse(const Html& svg) {
  pugi::xml_document document;
  EXPECT_TRUE(document.load_string(svg.markup().c_str()));
  return document;
}

// The bars of a class of the style sheet, in order.
std::vector<pugi::xml_node> Bars(const pugi::xml_document& document, const std::string& style) {
  std::vector<pugi::xml_node> bars;
  for (const pugi::xml_node& rect : document.child("svg").children("rect")) {
    if (rect.attribute("class").value() == style) bars.push_back(rect);
  }
  return bars;
}

TEST(PlotNumber, HasThreeDigits) {
  EXPECT_EQ(PlotNumber(0.61718), "0.617");
  EXPECT_EQ(PlotNumber(251210), "251,210");
  EXPECT_EQ(PlotNumber(-1234.5), "-1,235");
  EXPECT_EQ(PlotNumber(150.4), "150");
  EXPECT_EQ(PlotNumber(0), "0");
  EXPECT_EQ(PlotNumber(1e300), "1e+300");
  EXPECT_EQ(PlotNumber(NAN), "\xe2\x80\x93");
}

TEST(NiceCeiling, IsOneTwoOrFive) {
  EXPECT_DOUBLE_EQ(NiceCeiling(0.13), 0.2);
  EXPECT_DOUBLE_EQ(NiceCeiling(5), 5);
  EXPECT_DOUBLE_EQ(NiceCeiling(51), 100);
  EXPECT_DOUBLE_EQ(NiceCeiling(-1), 1);
}

TEST(BarPlot, LengthsAreProportional) {
  BarPlot plot;
  plot.rows = {{"measure", 40, 20.0, "40 s"}, {"crop", 10, std::nullopt, "10 s"}};
  plot.value_name = "used";
  plot.compared_name = "predicted";
  const pugi::xml_document document = Parse(ToSvg(plot));
  const auto used = Bars(document, "used"), predicted = Bars(document, "compared");
  ASSERT_EQ(used.size(), 3u) << "two bars and the legend";
  ASSERT_EQ(predicted.size(), 2u);
  const double longest = used[0].attribute("width").as_double();
  EXPECT_GT(longest, 100);
  EXPECT_NEAR(predicted[0].attribute("width").as_double(), longest / 2, 0.1);
  EXPECT_NEAR(used[1].attribute("width").as_double(), longest / 4, 0.1);
  EXPECT_THAT(ToSvg(plot).markup(), HasSubstr("<title>measure: 40</title>"));
}

TEST(LinePlot, LowerValuesAreLower) {
  LinePlot plot;
  plot.positions = {"a", "b", "c"};
  plot.lines = {{"energy", {0.3, 0.1, 0.2}}};
  const pugi::xml_document document = Parse(ToSvg(plot));
  std::istringstream points(document.child("svg").child("polyline").attribute("points").value());
  std::vector<double> y;
  char comma = 0;
  for (double px = 0, py = 0; points >> px >> comma >> py;) y.push_back(py);
  ASSERT_EQ(y.size(), 3u);
  EXPECT_NEAR((y[1] - y[0]) / 2, y[2] - y[0], 0.11) << "SVG's y points down";
  EXPECT_GT(y[1], y[0]);
  EXPECT_THAT(ToSvg(plot).markup(), HasSubstr(">0.3</text>"));
}

TEST(HistogramPlot, HeightsAreShares) {
  const pugi::xml_document document = Parse(ToSvg(HistogramPlot{"", 0, 1, {0.25, 0.5, 0, 0.25}, "confidence"}));
  const auto bars = Bars(document, "used");
  ASSERT_EQ(bars.size(), 4u);
  const double high = bars[1].attribute("height").as_double();
  EXPECT_GT(high, 50);
  EXPECT_NEAR(bars[0].attribute("height").as_double(), high / 2, 0.11);
  EXPECT_EQ(bars[2].attribute("height").as_double(), 0);
  EXPECT_STREQ(bars[1].child_value("title"), "0.25 to 0.5: 50.00 %");
}

TEST(Plots, HostileNamesAndNumbersStayText) {
  const std::string hostile = "<img src=x onerror=alert(1)>\xff";
  BarPlot bars;
  bars.title = bars.value_name = bars.compared_name = hostile;
  bars.rows = {{hostile, INFINITY, -1e300, hostile}, {"", NAN, std::nullopt, ""}};
  LinePlot lines;
  lines.positions = {hostile, hostile};
  lines.lines = {{hostile, {1e308, -1e308}}, {hostile, {NAN, INFINITY}}, {"", {}}};
  const HistogramPlot histogram = {hostile, 0, 1e300, {1, 0}, hostile};
  for (const Html& svg : {ToSvg(bars), ToSvg(lines), ToSvg(histogram)}) {
    EXPECT_THAT(svg.markup(), testing::Not(HasSubstr("<img")));
    EXPECT_THAT(svg.markup(), testing::Not(HasSubstr("nan")));
    if (!svg.empty()) Parse(svg);
  }
}

TEST(Plots, NothingGivesNothing) {
  EXPECT_TRUE(ToSvg(BarPlot()).empty());
  EXPECT_TRUE(ToSvg(LinePlot()).empty());
  EXPECT_TRUE(ToSvg(HistogramPlot()).empty());
}

}  // namespace
}  // namespace tessera
