#include "server/report_page/report_page.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "server/client/job_text.h"
#include "server/report_page/html_writer.h"
#include "server/report_page/job_facts.h"
#include "server/report_page/report_facts.h"
#include "server/report_page/report_sections.h"
#include "server/report_page/report_style.h"
#include "server/report_page/svg_plots.h"

namespace tessera {
namespace {

Html Paragraph(const std::string& style, const std::string& text) {
  return HtmlElement("p", {{"class", style}}, HtmlText(text));
}

Html Section(const std::string& title, const Html& content) {
  if (content.empty()) return {};
  return HtmlElement("section", HtmlElement("h2", HtmlText(title)) + content);
}

// One figure of the page: its name, its value, and a remark in small type.
Html Figure(const std::string& name, const std::string& value, const std::string& remark = "") {
  Html figure = HtmlElement("dt", HtmlText(name)) + HtmlElement("dd", HtmlText(value));
  if (!remark.empty()) figure += HtmlElement("dd", {{"class", "small"}}, HtmlText(remark));
  return HtmlElement("div", figure);
}

std::string AreaText(double m2) {
  return m2 >= 1e6 ? absl::StrCat(PlotNumber(m2 / 1e6), " km\xc2\xb2") : absl::StrCat(PlotNumber(m2), " m\xc2\xb2");
}

std::string OfStart(const std::optional<double>& count) {
  return count ? absl::StrCat("start mesh: ", CountText(*count)) : "";
}

Html MeshFigures(const PageFacts& facts) {
  const ReportFacts& report = facts.report;
  Html figures;
  if (report.faces) figures += Figure("Faces", CountText(*report.faces), OfStart(report.input_faces));
  if (report.vertices) figures += Figure("Vertices", CountText(*report.vertices), OfStart(report.input_vertices));
  if (facts.pictures && facts.pictures->area_m2 > 0) {
    figures += Figure("Surface area", AreaText(facts.pictures->area_m2),
                      absl::StrCat("seen from above: ", AreaText(facts.pictures->plan_area_m2)));
  }
  if (report.views) {
    const size_t skipped = report.skipped_images.size();
    figures += Figure("Images", CountText(*report.views), skipped > 0 ? absl::StrCat(skipped, " left out") : "");
  }
  if (report.gsd_m) figures += Figure("Ground sampling distance", absl::StrCat(PlotNumber(100 * *report.gsd_m), " cm"));
  if (const size_t tiles = report.tiles.size(); tiles > 0) {
    const size_t quarantined = facts.quarantined.size();
    figures += Figure("Tiles", CountText(static_cast<double>(tiles)),
                      quarantined > 0 ? absl::StrCat(quarantined, " quarantined") : "");
  }
  return figures;
}

std::string DisplacementText(const ReportFacts& report) {
  std::string text;
  for (const auto& [name, value] :
       {std::pair{"median ", report.median_m}, {"90 % below ", report.p90_m}, {"largest ", report.max_m}}) {
    if (value) absl::StrAppend(&text, text.empty() ? "" : ", ", name, MetresText(*value));
  }
  return text;
}

Html QualityFigures(const PageFacts& facts) {
  const ReportFacts& report = facts.report;
  Html figures;
  if (report.rms_m) figures += Figure("Displacement, rms", MetresText(*report.rms_m), DisplacementText(report));
  if (report.label_changes) {
    const double faces = report.faces.value_or(0);
    figures += Figure("Labels changed", CountText(*report.label_changes),
                      faces > 0 ? absl::StrCat(PercentText(*report.label_changes / faces), " of the faces") : "");
  }
  if (facts.pictures && facts.pictures->confidence_shares) {
    figures += Figure("Label confidence, mean", PlotNumber(facts.pictures->mean_confidence),
                      absl::StrCat(PercentText(facts.pictures->unseen_share), " of the area is in no image"));
  }
  if (report.fit) {
    figures += Figure("Image patches that match", PercentText(report.fit->result),
                      absl::StrCat("start: ", PercentText(report.fit->start), ", of ", CountText(report.fit->patches)));
  }
  if (report.seam_samples && report.seam_different && *report.seam_samples > 0) {
    std::string remark = absl::StrCat("of ", CountText(*report.seam_samples), " values that two tiles computed");
    if (report.seam_farthest_m && *report.seam_different > 0) {
      absl::StrAppend(&remark, "; by ", MetresText(*report.seam_farthest_m), " at most");
    }
    figures += Figure("Different at seams", CountText(*report.seam_different), remark);
  }
  if (facts.job && facts.job->seconds) {
    double core_s = 0;
    for (const auto& [kind, use] : facts.job->kinds) core_s += use.used_core_s;
    figures += Figure("Run time", FormatDuration(*facts.job->seconds),
                      core_s > 0 ? absl::StrCat("processor time: ", FormatDuration(core_s)) : "");
  }
  return figures;
}

Html PictureFigure(const ReportPictures& pictures, const std::string& jpeg, const std::string& title,
                   const std::string& text, const Html& scale = {}) {
  if (jpeg.empty()) return {};
  const Html picture = HtmlElement("img", {{"src", absl::StrCat("data:image/jpeg;base64,", absl::Base64Escape(jpeg))},
                                           {"width", absl::StrCat(pictures.width_px)},
                                           {"height", absl::StrCat(pictures.height_px)},
                                           {"alt", title}});
  const Html caption =
      HtmlElement("b", HtmlText(title)) + HtmlText(text.empty() ? "" : absl::StrCat(" \xe2\x80\x93 ", text));
  return HtmlElement("figure", picture + HtmlElement("figcaption", caption) + scale);
}

Html ColorScale(const std::function<Eigen::Vector3f(float)>& shade, float low, const std::vector<std::string>& ends) {
  constexpr int kStops = 8;
  std::string gradient = "background:linear-gradient(90deg";
  for (int i = 0; i <= kStops; ++i) {
    const Eigen::Vector3f color = 255 * shade(low + (1 - low) * static_cast<float>(i) / kStops);
    absl::StrAppend(
        &gradient, ",",
        HexColor({static_cast<uint8_t>(color[0]), static_cast<uint8_t>(color[1]), static_cast<uint8_t>(color[2])}));
  }
  Html texts;
  for (const std::string& end : ends) texts += HtmlElement("span", HtmlText(end));
  return HtmlElement("div", {{"class", "scale"}, {"style", gradient + ")"}}) +
         HtmlElement("div", {{"class", "ends"}}, texts);
}

Html ClassLegend(const std::vector<ReportClass>& classes) {
  Html entries;
  for (const ReportClass& c : classes) {
    if (!c.color_rgb) continue;
    entries += HtmlElement(
        "li", HtmlElement("span", {{"style", absl::StrCat("background:", HexColor(*c.color_rgb))}}) + HtmlText(c.name));
  }
  return entries.empty() ? Html() : HtmlElement("ul", {{"class", "legend"}}, entries);
}

Html PictureSection(const PageFacts& facts, const std::string& no_pictures) {
  if (!facts.pictures) return no_pictures.empty() ? Html() : Section("Pictures", Paragraph("soft", no_pictures));
  const ReportPictures& p = *facts.pictures;
  const auto pair = [](const Html& content) {
    return content.empty() ? Html() : HtmlElement("div", {{"class", "pair"}}, content);
  };
  Html content = pair(PictureFigure(p, p.start_shaded, "Start", "the mesh of the scene") +
                      PictureFigure(p, p.shaded, "Result", "after refinement"));
  if (!p.labels.empty() || !p.start_labels.empty()) {
    content += pair(PictureFigure(p, p.start_labels, "Classes at the start", "") +
                    PictureFigure(p, p.labels, "Classes in the result", ""));
    content += ClassLegend(p.classes);
  }
  const std::string range = MetresText(p.displacement_range_m);
  content +=
      pair(PictureFigure(p, p.displacement, "Displacement", "along the normals of the start mesh; red is outwards",
                         ColorScale(DisplacementShade, -1,
                                    {absl::StrCat("\xe2\x88\x92", range), "0", absl::StrCat("+", range)})) +
           PictureFigure(p, p.confidence, "Confidence of the labels", "grey: in no image",
                         ColorScale(ConfidenceShade, 0, {"0", "0.5", "1"})));
  if (!p.no_start.empty()) content += Paragraph("soft", p.no_start);
  return Section("Start and result", content);
}

Html PageHeader(const PageFacts& facts, const ReportPageInputs& inputs, const std::string& scene) {
  std::vector<std::string> parts;
  if (facts.job) {
    parts = {facts.job->name};
    if (facts.job->display_name != scene) parts.push_back(facts.job->display_name);
  }
  parts.push_back(inputs.finished.empty() ? "" : absl::StrCat("finished ", inputs.finished));
  if (facts.job) parts.push_back(facts.job->state);
  std::string line;
  for (const std::string& part : parts) {
    if (!part.empty()) absl::StrAppend(&line, line.empty() ? "" : " \xc2\xb7 ", part);
  }
  Html header = Paragraph("over", "Tessera \xc2\xb7 mesh refinement report") + HtmlElement("h1", HtmlText(scene));
  header += Paragraph("sub", line);
  return HtmlElement("header", header);
}

// What a reader must know first.
Html Notices(const PageFacts& facts) {
  Html notices;
  const auto note = [&](const std::string& style, const std::string& text) {
    notices += HtmlElement("p", {{"class", absl::StrCat("note ", style)}}, HtmlText(text));
  };
  if (facts.report.fit && facts.report.fit->worse) {
    note("bad",
         "The result fits the images worse than the start mesh. Do not use it before `tessera check` finds no fault in "
         "poses, images and mesh.");
  }
  if (!facts.quarantined.empty()) {
    note("warn", absl::StrCat(facts.quarantined.size(),
                              facts.quarantined.size() == 1 ? " tile is quarantined: its refinement"
                                                            : " tiles are quarantined: their refinement",
                              " failed. The mesh holds the last good state there, or the start mesh."));
  }
  if (facts.job && !facts.job->error.empty() && facts.quarantined.empty()) note("warn", facts.job->error);
  return notices;
}

Html SettingsTable(const PageFacts& facts) {
  if (!facts.job) return {};
  std::vector<std::pair<std::string, Html>> rows;
  for (const auto& [name, value] : facts.job->settings) rows.emplace_back(name, HtmlText(value));
  return FactTable(rows);
}

Html ProvenanceTable(const PageFacts& facts, const ReportPageInputs& inputs) {
  const JobFacts job = facts.job.value_or(JobFacts());
  std::vector<std::pair<std::string, Html>> rows = {{"Scene", HtmlText(job.scene)}};
  for (const auto& [name, value] : inputs.source) rows.emplace_back(name, HtmlText(value));
  std::string rollback;
  if (!job.rollback_to.empty()) {
    rollback = absl::StrCat(job.rollback_tiles.size(), " tiles restored as in ", job.rollback_to);
  }
  const auto code = [](const std::string& text) { return text.empty() ? Html() : HtmlElement("code", HtmlText(text)); };
  rows.insert(
      rows.end(),
      {{"Job", HtmlText(job.name)},
       {"Base job", HtmlText(job.base)},
       {"Update", HtmlText(inputs.update_summary)},
       {"Rollback", HtmlText(rollback)},
       {"Created", HtmlText(inputs.created)},
       {"Finished", HtmlText(inputs.finished)},
       {"Algorithm version", HtmlText(job.algorithm_version)},
       {"Program", HtmlText(inputs.program_version.empty() ? "" : absl::StrCat("tessera ", inputs.program_version))},
       {"SHA-256 of mesh.ply", code(inputs.mesh_sha256)},
       {"Command", code(inputs.command)}});
  return FactTable(rows);
}

}  // namespace

std::string MakeReportPage(const ReportPageInputs& inputs) {
  PageFacts facts;
  if (StatusOr<ReportFacts> report = ParseReportFacts(inputs.report_json); report.ok())
    facts.report = *std::move(report);
  if (StatusOr<JobFacts> job = ParseJobFacts(inputs.job_json); job.ok()) facts.job = *std::move(job);
  facts.pictures = inputs.pictures;
  for (const TileFacts& tile : facts.report.tiles) {
    if (tile.quarantined) facts.quarantined[tile.tile] = "";
  }
  if (facts.job) {
    for (const auto& [tile, why] : facts.job->quarantined) facts.quarantined[tile] = why;
  }
  std::string scene = facts.report.scene;
  if (scene.empty()) scene = inputs.scene_name;
  if (scene.empty() && facts.job) scene = facts.job->display_name;
  if (scene.empty()) scene = "Result";

  Html body = PageHeader(facts, inputs, scene) + Notices(facts);
  const Html figures = MeshFigures(facts) + QualityFigures(facts);
  if (!figures.empty()) body += HtmlElement("dl", {{"class", "figures"}}, figures);
  body += PictureSection(facts, inputs.no_pictures);
  body += Section("Warnings", WarningList(facts));
  body += Section("Quality", QualityPlots(facts));
  body += Section("Time and memory", ResourcePlots(facts));
  body += Section("Tiles", TileTable(facts));
  body += Section("Images left out", SkippedImages(facts));
  body += Section("Settings", SettingsTable(facts));
  body += Section("Provenance", ProvenanceTable(facts, inputs));
  body += HtmlElement("footer",
                      HtmlText("Figures are those of report.json and job.json beside this file. Areas, confidence and "
                               "displacement along normals are computed from mesh.ply."));
  return HtmlDocument(absl::StrCat(scene, " \xc2\xb7 Tessera report"), ReportStyle(), HtmlElement("main", body));
}

}  // namespace tessera
