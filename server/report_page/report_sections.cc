#include "server/report_page/report_sections.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/client/job_text.h"
#include "server/report_page/svg_plots.h"

namespace tessera {
namespace {

constexpr size_t kMostTileLines = 60;  // in the plot of energies
constexpr size_t kMostTiles = 200, kMostWarnings = 200, kMostImages = 100, kMostClasses = 40, kMostKinds = 20;

Html PlotFigure(const std::string& title, const std::string& text, const Html& plot) {
  if (plot.empty()) return {};
  Html content = HtmlElement("h3", HtmlText(title));
  if (!text.empty()) content += HtmlElement("p", {{"class", "soft"}}, HtmlText(text));
  return HtmlElement("figure", content + plot);
}

Html PlotGrid(const Html& figures) {
  return figures.empty() ? Html() : HtmlElement("div", {{"class", "plots"}}, figures);
}

Html MoreText(size_t all, size_t shown, const std::string& what) {
  if (all <= shown) return {};
  return HtmlElement(
      "p", {{"class", "soft"}},
      HtmlText(absl::StrCat("and ", FormatThousands(static_cast<long long>(all - shown)), " more ", what)));
}

// Energies of a tile at the first and last step of each round; empty if one is missing.
std::vector<double> EnergiesOf(const TileFacts& tile, size_t rounds) {
  std::vector<double> energies;
  for (const RoundFacts& round : tile.rounds) {
    if (!round.energy_start || !round.energy_end) return {};
    energies.push_back(*round.energy_start);
    energies.push_back(*round.energy_end);
  }
  return energies.size() == 2 * rounds ? energies : std::vector<double>();
}

Html EnergyPlot(const ReportFacts& report) {
  size_t rounds = 0;
  for (const TileFacts& tile : report.tiles) rounds = std::max(rounds, tile.rounds.size());
  if (rounds == 0 || rounds > 20) return {};
  LinePlot plot;
  plot.title = "photo energy by round";
  for (size_t i = 0; i < rounds; ++i) {
    plot.positions.push_back(absl::StrCat("round ", i + 1, "\nfirst step"));
    plot.positions.push_back(absl::StrCat("round ", i + 1, "\nlast step"));
  }
  LinePlot::Line mean;
  mean.name = "mean of the tiles, by pixels";
  mean.values.assign(2 * rounds, 0.0);
  double weights = 0;
  size_t tiles = 0;
  for (const TileFacts& tile : report.tiles) {
    const std::vector<double> energies = EnergiesOf(tile, rounds);
    if (energies.empty()) continue;
    const double weight = std::max(tile.rounds.front().warped_pixels, 1.0);
    for (size_t i = 0; i < energies.size(); ++i) mean.values[i] += weight * energies[i];
    weights += weight;
    if (++tiles <= kMostTileLines) plot.lines.push_back({absl::StrCat("tile ", tile.tile), energies, false});
  }
  if (tiles == 0) return {};
  for (double& value : mean.values) value /= weights;
  if (tiles == 1) plot.lines.clear();
  plot.lines.push_back(mean);
  return PlotFigure("Photo energy",
                    absl::StrCat("1 \xe2\x88\x92 ZNCC at the finest level, robust mean; lower is better.",
                                 tiles > 1 ? " Thin lines: tiles." : ""),
                    ToSvg(plot));
}

Html LabelChangePlot(const ReportFacts& report) {
  BarPlot plot;
  plot.title = "labels changed by step";
  double first = 0;
  std::vector<double> changes;
  for (const TileFacts& tile : report.tiles) {
    first += tile.first_label_changes.value_or(0);
    changes.resize(std::max(changes.size(), tile.rounds.size()), 0.0);
    for (size_t i = 0; i < tile.rounds.size(); ++i) changes[i] += tile.rounds[i].label_changes.value_or(0);
  }
  if (first > 0) plot.rows.push_back({"first labels", first, std::nullopt, CountText(first)});
  for (size_t i = 0; i < std::min<size_t>(changes.size(), 20); ++i) {
    plot.rows.push_back({absl::StrCat("round ", i + 1), changes[i], std::nullopt, CountText(changes[i])});
  }
  const bool any = std::any_of(plot.rows.begin(), plot.rows.end(), [](const auto& row) { return row.value > 0; });
  return any ? PlotFigure("Labels changed", "Faces whose label a label step changed.", ToSvg(plot)) : Html();
}

Html ClassPlot(const PageFacts& facts) {
  BarPlot plot;
  plot.title = "share of the area by class";
  plot.value_name = "result";
  plot.compared_name = "start";
  const std::map<std::string, double> before(facts.report.shares_before.begin(), facts.report.shares_before.end());
  std::map<std::string, std::array<uint8_t, 3>> colors;
  if (facts.pictures) {
    for (const ReportClass& c : facts.pictures->classes) {
      if (c.color_rgb) colors[c.name] = *c.color_rgb;
    }
  }
  std::vector<std::pair<std::string, double>> shares = facts.report.shares_after;
  const std::vector<std::string>& names = facts.report.classes;
  const auto index_of = [&](const auto& share) { return std::find(names.begin(), names.end(), share.first); };
  std::stable_sort(shares.begin(), shares.end(),
                   [&](const auto& a, const auto& b) { return index_of(a) < index_of(b); });
  for (const auto& [name, after] : shares) {
    if (plot.rows.size() == kMostClasses) break;
    const auto start = before.find(name);
    BarPlot::Row row = {name, after, std::nullopt, PercentText(after)};
    if (start != before.end()) {
      row.compared = start->second;
      absl::StrAppend(&row.text, "  (", PercentText(start->second), ")");
    }
    row.color_rgb = std::array<uint8_t, 3>{128, 138, 148};
    if (const auto color = colors.find(name); color != colors.end()) row.color_rgb = color->second;
    plot.rows.push_back(row);
  }
  return PlotFigure("Area by class", "Share of the surface; at the start in brackets.", ToSvg(plot));
}

Html FitPlot(const ReportFacts& report) {
  if (!report.fit) return {};
  BarPlot plot;
  plot.title = "image patches that match";
  plot.rows = {{"start", report.fit->start, std::nullopt, PercentText(report.fit->start)},
               {"result", report.fit->result, std::nullopt, PercentText(report.fit->result)}};
  return PlotFigure("Images that match through the mesh",
                    absl::StrCat("Share of ", CountText(report.fit->patches),
                                 " image patches that correlate with another image better than by chance."),
                    ToSvg(plot));
}

Html DistributionPlot(const std::string& title, const std::string& text, const std::string& axis,
                      const std::optional<Distribution>& distribution) {
  if (!distribution) return {};
  return PlotFigure(title, text,
                    ToSvg(HistogramPlot{title, distribution->low, distribution->high, distribution->shares, axis}));
}

// Numbers in a unit that fits the largest of them.
struct Unit {
  double size = 1;
  std::string name;
};

Unit TimeUnit(double largest_s) {
  if (largest_s >= 2 * 3600) return {3600, "h"};
  return largest_s >= 600 ? Unit{60, "min"} : Unit{1, "s"};
}

Unit MemoryUnit(double largest_bytes) {
  constexpr double kMiB = 1 << 20, kGiB = 1 << 30;
  return largest_bytes >= 2 * kGiB ? Unit{kGiB, "GiB"} : Unit{kMiB, "MiB"};
}

// One row a kind of task: the used amount, and the predicted one behind it.
Html KindPlot(const std::string& title, std::vector<std::tuple<std::string, double, double>> rows,
              Unit (*unit_of)(double)) {
  std::sort(rows.begin(), rows.end(), [](const auto& a, const auto& b) { return std::get<1>(a) > std::get<1>(b); });
  if (rows.empty()) return {};
  rows.resize(std::min(rows.size(), kMostKinds));
  double largest = 0;
  for (const auto& [name, used, predicted] : rows) largest = std::max({largest, used, predicted});
  const Unit unit = unit_of(largest);
  BarPlot plot;
  plot.title = title;
  plot.value_name = "used";
  plot.compared_name = "predicted";
  for (const auto& [name, used, predicted] : rows) {
    BarPlot::Row row = {name, used / unit.size, std::nullopt,
                        absl::StrCat(PlotNumber(used / unit.size), " ", unit.name)};
    if (predicted > 0) {
      row.compared = predicted / unit.size;
      absl::StrAppend(&row.text, "  (", PlotNumber(*row.compared), ")");
    }
    plot.rows.push_back(row);
  }
  return ToSvg(plot);
}

Html NumberCell(const std::string& text) { return HtmlElement("td", {{"class", "number"}}, HtmlText(text)); }

// Tiles that need a look come first.
int Urgency(const PageFacts& facts, const TileFacts& tile) {
  if (facts.quarantined.contains(tile.tile)) return 0;
  return tile.fit && tile.fit->result < tile.fit->start - 0.02 ? 1 : 2;
}

Html TileRow(const PageFacts& facts, const TileFacts& tile, const MeasuredTasks* use) {
  double changes = tile.first_label_changes.value_or(0);
  std::string energy;
  if (!tile.rounds.empty() && tile.rounds.front().energy_start && tile.rounds.back().energy_end) {
    energy =
        absl::StrFormat("%.4f \xe2\x86\x92 %.4f", *tile.rounds.front().energy_start, *tile.rounds.back().energy_end);
  }
  for (const RoundFacts& round : tile.rounds) changes += round.label_changes.value_or(0);
  Html row = NumberCell(tile.tile >= 0 ? absl::StrCat(tile.tile) : "") +
             NumberCell(tile.faces ? CountText(*tile.faces) : "") +
             NumberCell(tile.views ? CountText(*tile.views) : "") + NumberCell(energy);
  row += NumberCell(
      tile.fit ? absl::StrCat(PercentText(tile.fit->start), " \xe2\x86\x92 ", PercentText(tile.fit->result)) : "");
  row += NumberCell(CountText(changes));
  row += NumberCell(use != nullptr && use->used_core_s > 0 ? FormatDuration(use->used_core_s) : "");
  row += NumberCell(
      use != nullptr && use->used_peak_bytes > 0 ? absl::StrFormat("%.0f MiB", use->used_peak_bytes / (1 << 20)) : "");
  Html note;
  if (const auto found = facts.quarantined.find(tile.tile); found != facts.quarantined.end()) {
    note = HtmlElement("b", {{"class", "bad"}}, HtmlText("quarantined"));
    if (!found->second.empty()) note += HtmlText(absl::StrCat(" ", found->second));
  } else if (Urgency(facts, tile) == 1) {
    note = HtmlElement("span", {{"class", "warn"}}, HtmlText("images match less than at the start"));
  }
  return HtmlElement("tr", row + HtmlElement("td", note));
}

}  // namespace

std::string PercentText(double share) { return absl::StrFormat("%.1f %%", 100 * share); }

std::string CountText(double count) {
  return std::abs(count) < 1e18 ? FormatThousands(static_cast<long long>(count)) : PlotNumber(count);
}

std::string MetresText(double m) { return absl::StrCat(PlotNumber(m), " m"); }

Html WarningList(const PageFacts& facts) {
  std::vector<std::string> warnings;
  std::set<std::string> known;
  const auto add = [&](const std::vector<std::string>& from) {
    for (const std::string& warning : from) {
      if (known.insert(warning).second) warnings.push_back(warning);
    }
  };
  add(facts.report.warnings);
  if (facts.job) add(facts.job->warnings);
  Html items;
  for (size_t i = 0; i < std::min(warnings.size(), kMostWarnings); ++i)
    items += HtmlElement("li", HtmlText(warnings[i]));
  if (items.empty()) return {};
  return HtmlElement("ul", items) + MoreText(warnings.size(), kMostWarnings, "warnings in report.json and job.json");
}

Html QualityPlots(const PageFacts& facts) {
  Html figures = EnergyPlot(facts.report) + FitPlot(facts.report);
  if (facts.pictures) {
    figures += DistributionPlot("Displacement", "Share of the surface; values beyond the ends are in the outer bars.",
                                "along the normals of the start mesh, metres", facts.pictures->displacement_shares);
    figures += DistributionPlot("Confidence of the labels", "Share of the surface that an image shows.",
                                "confidence, 0 to 1", facts.pictures->confidence_shares);
  }
  figures += ClassPlot(facts) + LabelChangePlot(facts.report);
  return PlotGrid(figures);
}

Html ResourcePlots(const PageFacts& facts) {
  if (!facts.job) return {};
  std::vector<std::tuple<std::string, double, double>> times, memories;
  for (const auto& [kind, use] : facts.job->kinds) {
    if (use.used_core_s > 0) times.emplace_back(kind, use.used_core_s, use.predicted_core_s);
    if (use.used_peak_bytes > 0) memories.emplace_back(kind, use.used_peak_bytes, use.predicted_peak_bytes);
  }
  Html content = PlotGrid(PlotFigure("Processor time by kind of task", "All tasks together; predicted in brackets.",
                                     KindPlot("processor time by kind of task", times, TimeUnit)) +
                          PlotFigure("Memory by kind of task", "The largest task; predicted in brackets.",
                                     KindPlot("memory by kind of task", memories, MemoryUnit)));
  if (facts.job->tasks && facts.job->attempts) {
    content += HtmlElement(
        "p", {{"class", "soft"}},
        HtmlText(absl::StrCat(CountText(*facts.job->tasks), " tasks, ", CountText(facts.job->reused.value_or(0)),
                              " of them reused from earlier "
                              "jobs, ",
                              CountText(*facts.job->attempts), " attempts.")));
  }
  return content;
}

Html TileTable(const PageFacts& facts) {
  if (facts.report.tiles.size() < 2) return {};
  std::vector<const TileFacts*> tiles;
  for (const TileFacts& tile : facts.report.tiles) tiles.push_back(&tile);
  std::stable_sort(tiles.begin(), tiles.end(),
                   [&](const TileFacts* a, const TileFacts* b) { return Urgency(facts, *a) < Urgency(facts, *b); });
  Html head;
  for (const char* name : {"tile", "faces", "images", "photo energy", "patches that match", "labels changed",
                           "processor time", "memory"}) {
    head += HtmlElement("th", {{"class", "number"}}, HtmlText(name));
  }
  Html rows = HtmlElement("tr", head + HtmlElement("th", Html()));
  for (size_t i = 0; i < std::min(tiles.size(), kMostTiles); ++i) {
    const MeasuredTasks* use = nullptr;
    if (facts.job) {
      if (const auto found = facts.job->tiles.find(tiles[i]->tile); found != facts.job->tiles.end())
        use = &found->second;
    }
    rows += TileRow(facts, *tiles[i], use);
  }
  return HtmlElement("div", {{"class", "scroll"}}, HtmlElement("table", rows)) +
         MoreText(tiles.size(), kMostTiles, "tiles in report.json");
}

Html SkippedImages(const PageFacts& facts) {
  const auto& images = facts.report.skipped_images;
  if (images.empty()) return {};
  Html items;
  for (size_t i = 0; i < std::min(images.size(), kMostImages); ++i) {
    items +=
        HtmlElement("li", HtmlElement("b", HtmlText(images[i].first)) + HtmlText(absl::StrCat(": ", images[i].second)));
  }
  return HtmlElement("ul", items) + MoreText(images.size(), kMostImages, "images in report.json");
}

Html FactTable(const std::vector<std::pair<std::string, Html>>& facts) {
  Html rows;
  for (const auto& [name, value] : facts) {
    if (!value.empty()) rows += HtmlElement("tr", HtmlElement("th", HtmlText(name)) + HtmlElement("td", value));
  }
  return rows.empty() ? Html() : HtmlElement("table", {{"class", "facts"}}, rows);
}

}  // namespace tessera
