#include "common/classify/classify_report.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace tessera {
namespace {

using OrderedJson = nlohmann::ordered_json;

constexpr size_t kShownImages = 3;

std::string Title(size_t evidence) {
  return evidence == 0 ? "appearance only (for comparison)" : "appearance and start mesh (read by jobs)";
}

// Rows are annotated classes; values are shares of the row.
std::string ConfusionTable(const ConfusionMatrix& confusion, const std::vector<SceneClass>& classes) {
  std::string text = absl::StrFormat("    %-14s %10s", "annotated as", "pixels");
  for (const SceneClass& c : classes) absl::StrAppendFormat(&text, " %10.10s", c.name);
  text += "\n";
  for (size_t t = 0; t < classes.size(); ++t) {
    const int64_t total = confusion.truth_total(static_cast<int>(t));
    absl::StrAppendFormat(&text, "    %-14.14s %10d", classes[t].name, total);
    for (size_t r = 0; r < classes.size(); ++r) {
      const int64_t count = confusion.at(static_cast<int>(t), static_cast<int>(r));
      absl::StrAppendFormat(&text, " %10s", total == 0 ? "-" : absl::StrFormat("%.3f", 1.0 * count / total));
    }
    text += "\n";
  }
  return text;
}

// The JSON library writes NaN as null.
OrderedJson EvidenceJson(const ClassifyReport& report, size_t e) {
  const ConfusionMatrix& confusion = report.classified->held_out[e];
  const HeldOutStatistics& figures = report.trained->held_out[e];
  const LabelScores scores = ScoreLabels(confusion);
  OrderedJson json = {{"overall_accuracy", scores.overall_accuracy},
                      {"average_accuracy", scores.average_accuracy},
                      {"mean_iou", scores.mean_iou},
                      {"temperature", figures.temperature},
                      {"log_loss", {{"raw", figures.log_loss_before}, {"calibrated", figures.log_loss_after}}},
                      {"calibration_error",
                       {{"raw", figures.calibration_error_before}, {"calibrated", figures.calibration_error_after}}}};
  for (int t = 0; t < confusion.classes(); ++t) {
    OrderedJson row = OrderedJson::array();
    for (int r = 0; r < confusion.classes(); ++r) row.push_back(confusion.at(t, r));
    json["confusion"].push_back(std::move(row));
  }
  return json;
}

}  // namespace

std::vector<size_t> NextToAnnotate(const ClassifiedScene& classified) {
  std::vector<size_t> order;
  for (size_t v = 0; v < classified.views.size(); ++v) {
    if (!classified.views[v].annotated) order.push_back(v);
  }
  std::stable_sort(order.begin(), order.end(),
                   [&](size_t a, size_t b) { return classified.views[a].gain > classified.views[b].gain; });
  return order;
}

std::string ClassifyText(const ClassifyReport& report) {
  const SceneDescription& scene = *report.scene;
  std::string text = absl::StrFormat("images                 %d, %.1f million pixels\n", scene.views.size(),
                                     1e-6 * static_cast<double>(report.classified->pixels));
  absl::StrAppendFormat(&text, "GSD                    %.3f m\n", report.gsd_m);
  if (report.source == "default") {
    text +=
        "likelihoods            default rule (mesh and greenness), not trained on this scene:\n"
        "                       annotate a few images and pass --train DIR for better likelihoods\n";
  }
  if (report.model_gsd_m) absl::StrAppendFormat(&text, "GSD of the model       %.3f m\n", *report.model_gsd_m);
  if (report.trained != nullptr) {
    absl::StrAppendFormat(&text, "annotated              %d images, %d pixels (%d used for training)\n",
                          report.annotations->images.size(), report.annotations->annotated(), report.trained->samples);
    absl::StrAppendFormat(&text, "cross-validation       spatial: %d folds of cells of %.1f m\n",
                          report.trained->spatial_folds.folds(), report.trained->spatial_folds.cell_m());
    for (size_t e = 0; e < 2; ++e) {
      const LabelScores scores = ScoreLabels(report.classified->held_out[e]);
      const HeldOutStatistics& figures = report.trained->held_out[e];
      absl::StrAppendFormat(&text,
                            "  %s\n    OA %.3f  AA %.3f  mIoU %.3f; calibration error %.3f (%.3f before calibration)\n",
                            Title(e), scores.overall_accuracy, scores.average_accuracy, scores.mean_iou,
                            figures.calibration_error_after, figures.calibration_error_before);
      text += ConfusionTable(report.classified->held_out[e], scene.classes);
    }
  }
  if (report.source != "default") {
    const std::vector<size_t> next = NextToAnnotate(*report.classified);
    if (!next.empty()) text += "annotate next          uncertainty, share of pixels outside annotated areas\n";
    for (size_t k = 0; k < std::min(kShownImages, next.size()); ++k) {
      const ViewStatistics& view = report.classified->views[next[k]];
      absl::StrAppendFormat(&text, "  %-20s %.3f, %.2f\n", scene.views[next[k]].name, view.entropy, view.new_share);
    }
  }
  if (report.trained != nullptr) absl::StrAppendFormat(&text, "CPU, training          %.1f s\n", report.train_cpu_s);
  absl::StrAppendFormat(
      &text, "CPU, classification    %.1f s, %.2f us per pixel\n", report.classify_cpu_s,
      1e6 * report.classify_cpu_s / static_cast<double>(std::max<int64_t>(1, report.classified->pixels)));
  return text;
}

std::string ClassifyJson(const ClassifyReport& report) {
  const SceneDescription& scene = *report.scene;
  OrderedJson json = {{"scene", scene.name}, {"source", report.source}, {"gsd_m", report.gsd_m}};
  if (report.model_gsd_m) json["model_gsd_m"] = *report.model_gsd_m;
  json["classes"] = ClassNames(scene);
  if (report.trained != nullptr) {
    for (const Annotation& a : report.annotations->images) json["annotated"].push_back(scene.views[a.view].name);
    json["annotated_pixels"] = report.annotations->pixels;
    json["samples"] = report.trained->samples;
    json["cross_validation"] = {{"folds", report.trained->spatial_folds.folds()},
                                {"cell_m", report.trained->spatial_folds.cell_m()}};
    for (size_t e = 0; e < 2; ++e) json["cross_validation"][kEvidenceNames[e]] = EvidenceJson(report, e);
  }
  for (size_t v = 0; v < scene.views.size(); ++v) {
    const ViewStatistics& view = report.classified->views[v];
    json["images"].push_back({{"name", scene.views[v].name},
                              {"annotated", view.annotated},
                              {"uncertainty", view.entropy},
                              {"new_share", view.new_share},
                              {"gain", view.gain}});
  }
  for (const size_t v : NextToAnnotate(*report.classified)) json["annotate_next"].push_back(scene.views[v].name);
  json["warnings"] = report.warnings;
  json["train_cpu_s"] = report.train_cpu_s;
  json["classify_cpu_s"] = report.classify_cpu_s;
  return json.dump(2, ' ', false, OrderedJson::error_handler_t::replace) + "\n";
}

}  // namespace tessera
