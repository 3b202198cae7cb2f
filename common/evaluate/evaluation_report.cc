#include "common/evaluate/evaluation_report.h"

#include <absl/strings/str_format.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>

namespace tessera {
namespace {

using Json = nlohmann::ordered_json;
using Metric = std::function<double(const Evaluation&)>;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr int kNameWidth = 34, kColumnWidth = 11;

std::string Number(double value, const char* unit_format) {
  if (std::isnan(value)) return "-";
  return unit_format[0] == 'd' ? absl::StrFormat("%.0f", value) : absl::StrFormat("%.4f", value);
}

class Table {
 public:
  explicit Table(const std::vector<NamedEvaluation>& evaluations) : evaluations_(evaluations) {}

  void Head(const std::string& title) {
    text_ += absl::StrFormat("%s%-*s", text_.empty() ? "" : "\n", kNameWidth, title);
    for (const NamedEvaluation& e : evaluations_) text_ += absl::StrFormat("%*s", kColumnWidth, e.name);
    if (evaluations_.size() == 2) text_ += absl::StrFormat("%*s", kColumnWidth, "ratio");
    text_ += "\n";
  }

  void Row(const std::string& name, const Metric& figure, const char* format = "f") {
    std::vector<double> values;
    bool any = false;
    for (const NamedEvaluation& e : evaluations_) {
      values.push_back(figure(e.evaluation));
      any = any || !std::isnan(values.back());
    }
    if (!any) return;
    text_ += absl::StrFormat("  %-*s", kNameWidth - 2, name);
    for (double value : values) text_ += absl::StrFormat("%*s", kColumnWidth, Number(value, format));
    if (values.size() == 2) {
      const double ratio = values[0] == 0 ? kNone : values[1] / values[0];
      text_ += absl::StrFormat("%*s", kColumnWidth, std::isnan(ratio) ? "-" : absl::StrFormat("%.3f", ratio));
    }
    text_ += "\n";
  }

  void Line(const std::string& line) { text_ += line + "\n"; }
  const std::string& text() const { return text_; }

 private:
  const std::vector<NamedEvaluation>& evaluations_;
  std::string text_;
};

void AddDistanceRows(Table* table, const std::string& name, DistanceStatistics SurfaceScores::*member) {
  const auto row = [&](const std::string& what, double DistanceStatistics::*figure) {
    table->Row(name + " " + what, [=](const Evaluation& e) { return e.surface.*member.*figure; });
  };
  row("mean", &DistanceStatistics::mean_m);
  row("mean, capped", &DistanceStatistics::capped_mean_m);
  row("median", &DistanceStatistics::median_m);
  row("90 %", &DistanceStatistics::percentile90_m);
}

const SurfaceScores* OfClass(const Evaluation& e, size_t c) {
  return c < e.surface_by_class.size() ? &e.surface_by_class[c] : nullptr;
}

void AddClassRows(Table* table, const std::vector<std::string>& classes) {
  const auto rows = [&](const std::string& what, const std::function<double(const SurfaceScores&)>& figure) {
    for (size_t c = 0; c < classes.size(); ++c) {
      table->Row(what + ", " + classes[c], [&, c](const Evaluation& e) {
        const SurfaceScores* scores = OfClass(e, c);
        return scores ? figure(*scores) : kNone;
      });
    }
  };
  rows("accuracy, capped", [](const SurfaceScores& s) { return s.accuracy.capped_mean_m; });
  rows("completeness, capped", [](const SurfaceScores& s) { return s.completeness.capped_mean_m; });
  rows("normal consistency", [](const SurfaceScores& s) { return s.normal_consistency; });
}

void AddLabelRows(Table* table, const std::vector<std::string>& classes,
                  const std::function<const LabelEvaluation*(const Evaluation&)>& labels) {
  const auto row = [&](const std::string& name, const std::function<double(const LabelScores&)>& figure) {
    table->Row(name, [&](const Evaluation& e) { return labels(e) ? figure(labels(e)->scores) : kNone; });
  };
  row("overall accuracy (OA)", [](const LabelScores& s) { return s.overall_accuracy; });
  row("average accuracy (AA)", [](const LabelScores& s) { return s.average_accuracy; });
  row("mean IoU", [](const LabelScores& s) { return s.mean_iou; });
  for (size_t c = 0; c < classes.size(); ++c) {
    row("recall, " + classes[c], [c](const LabelScores& s) { return s.classes[c].recall; });
  }
  for (size_t c = 0; c < classes.size(); ++c) {
    row("IoU, " + classes[c], [c](const LabelScores& s) { return s.classes[c].iou; });
  }
}

void AddConfusion(Table* table, const std::string& name, const ConfusionMatrix& confusion,
                  const std::vector<std::string>& classes) {
  table->Line("");
  std::string head = absl::StrFormat("%-*s", kNameWidth, "Confusion, % of the truth's pixels, " + name);
  table->Line(head);
  head = absl::StrFormat("  %-*s", kNameWidth - 2, "truth \\ " + name);
  for (const std::string& c : classes) head += absl::StrFormat("%*s", kColumnWidth, c.substr(0, kColumnWidth - 1));
  table->Line(head + absl::StrFormat("%*s", kColumnWidth, "nothing"));
  for (int t = 0; t < confusion.classes(); ++t) {
    const double total = static_cast<double>(confusion.truth_total(t));
    if (total == 0) continue;
    std::string line = absl::StrFormat("  %-*s", kNameWidth - 2, classes[t]);
    for (int r = 0; r <= confusion.classes(); ++r) {
      line += absl::StrFormat("%*.2f", kColumnWidth, 100 * static_cast<double>(confusion.at(t, r)) / total);
    }
    table->Line(line);
  }
}

// Figures that could not be measured are NaN, which the JSON library writes as null.

Json ToJson(const DistanceStatistics& s) {
  return {{"points", s.points},
          {"mean_m", s.mean_m},
          {"capped_mean_m", s.capped_mean_m},
          {"median_m", s.median_m},
          {"percentile90_m", s.percentile90_m},
          {"normal_consistency", s.normal_consistency}};
}

Json ToJson(const SurfaceScores& s) {
  Json f_scores = Json::array();
  for (const FScore& f : s.f_scores) {
    f_scores.push_back({{"distance_m", f.distance_m}, {"precision", f.precision}, {"recall", f.recall}, {"f", f.f}});
  }
  return {{"accuracy", ToJson(s.accuracy)},
          {"completeness", ToJson(s.completeness)},
          {"f_scores", f_scores},
          {"normal_consistency", s.normal_consistency}};
}

Json ToJson(const LabelEvaluation& labels, const std::vector<std::string>& classes) {
  Json by_class = Json::object(), matrix = Json::array();
  for (int t = 0; t < labels.confusion.classes(); ++t) {
    const ClassLabelScore& s = labels.scores.classes[t];
    by_class[classes[t]] = {{"recall", s.recall}, {"precision", s.precision}, {"iou", s.iou}};
    Json row = Json::array();
    for (int r = 0; r <= labels.confusion.classes(); ++r) row.push_back(labels.confusion.at(t, r));
    matrix.push_back(row);
  }
  return {{"counted", labels.scores.counted},
          {"overall_accuracy", labels.scores.overall_accuracy},
          {"average_accuracy", labels.scores.average_accuracy},
          {"mean_iou", labels.scores.mean_iou},
          {"by_class", by_class},
          {"confusion_truth_by_result_and_nothing", matrix}};
}

Json ToJson(const Evaluation& e, const std::vector<std::string>& classes) {
  Json json = {{"faces", e.faces}, {"area_m2", e.area_m2}, {"surface", ToJson(e.surface)}};
  if (!e.surface_by_class.empty()) {
    for (size_t c = 0; c < classes.size(); ++c) json["surface_by_class"][classes[c]] = ToJson(e.surface_by_class[c]);
  }
  json["labels_by_area"] = e.labels_by_area ? ToJson(*e.labels_by_area, classes) : Json(nullptr);
  json["labels_by_pixels"] = nullptr;
  if (e.labels_by_pixels) {
    Json pixels = ToJson(*e.labels_by_pixels, classes);
    pixels["views"] = e.labels_by_pixels->views;
    pixels["boundary_f"] = e.labels_by_pixels->boundary_f;
    for (size_t c = 0; c < classes.size(); ++c) {
      pixels["boundary_f_by_class"][classes[c]] = BoundaryF(e.labels_by_pixels->boundaries[c]);
    }
    json["labels_by_pixels"] = pixels;
  }
  return json;
}

}  // namespace

std::string EvaluationTable(const std::vector<NamedEvaluation>& evaluations, const std::vector<std::string>& classes,
                            const EvaluationOptions& options) {
  Table table(evaluations);
  table.Head("Geometry, metres");
  table.Row(
      "faces", [](const Evaluation& e) { return static_cast<double>(e.faces); }, "d");
  table.Row(
      "points measured on the mesh", [](const Evaluation& e) { return static_cast<double>(e.surface.accuracy.points); },
      "d");
  table.Row(
      "points measured on the truth",
      [](const Evaluation& e) { return static_cast<double>(e.surface.completeness.points); }, "d");
  AddDistanceRows(&table, "accuracy", &SurfaceScores::accuracy);
  AddDistanceRows(&table, "completeness", &SurfaceScores::completeness);
  for (size_t i = 0; i < options.f_distances_m.size(); ++i) {
    table.Row(absl::StrFormat("F-score at %g m", options.f_distances_m[i]),
              [i](const Evaluation& e) { return e.surface.f_scores[i].f; });
  }
  table.Row("normal consistency", [](const Evaluation& e) { return e.surface.normal_consistency; });
  AddClassRows(&table, classes);

  bool area = false, pixels = false;
  for (const NamedEvaluation& e : evaluations) {
    area = area || e.evaluation.labels_by_area;
    pixels = pixels || e.evaluation.labels_by_pixels;
  }
  if (area) {
    table.Head("Labels by area");
    AddLabelRows(&table, classes, [](const Evaluation& e) -> const LabelEvaluation* {
      return e.labels_by_area ? &*e.labels_by_area : nullptr;
    });
  }
  if (pixels) {
    table.Head("Labels by rendered pixels");
    AddLabelRows(&table, classes, [](const Evaluation& e) -> const LabelEvaluation* {
      return e.labels_by_pixels ? &*e.labels_by_pixels : nullptr;
    });
    table.Row(absl::StrFormat("boundary F within %d px", options.boundary_reach_px),
              [](const Evaluation& e) { return e.labels_by_pixels ? e.labels_by_pixels->boundary_f : kNone; });
    for (const NamedEvaluation& e : evaluations) {
      if (e.evaluation.labels_by_pixels) {
        AddConfusion(&table, e.name, e.evaluation.labels_by_pixels->confusion, classes);
      }
    }
  }
  table.Line(
      absl::StrFormat("\n%d points drawn by area (seed %d), seen by at least %d cameras, rim of %g m left out, "
                      "distances capped at %g m.",
                      options.samples, options.seed, options.min_views, options.rim_m, options.cap_m));
  return table.text();
}

std::string EvaluationJson(const std::vector<NamedEvaluation>& evaluations, const std::vector<std::string>& classes,
                           const EvaluationOptions& options) {
  Json json = {{"options",
                {{"samples", options.samples},
                 {"seed", options.seed},
                 {"min_views", options.min_views},
                 {"rim_m", options.rim_m},
                 {"cap_m", options.cap_m},
                 {"f_distances_m", options.f_distances_m},
                 {"boundary_reach_px", options.boundary_reach_px}}},
               {"classes", classes},
               {"meshes", Json::object()}};
  for (const NamedEvaluation& e : evaluations) json["meshes"][e.name] = ToJson(e.evaluation, classes);
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace tessera
