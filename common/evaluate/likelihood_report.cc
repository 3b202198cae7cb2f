// Evaluation of likelihoods against true labels, as table and JSON.
#include <absl/strings/str_format.h>

#include <nlohmann/json.hpp>

#include "common/evaluate/evaluation_report.h"

namespace tessera {
namespace {

ConfusionMatrix Sum(const std::vector<LikelihoodConfusion>& views, size_t classes,
                    ConfusionMatrix LikelihoodConfusion::*of = &LikelihoodConfusion::likelihoods) {
  ConfusionMatrix all(static_cast<int>(classes));
  for (const LikelihoodConfusion& view : views) {
    if ((view.*of).classes() > 0) all.Add(view.*of);
  }
  return all;
}

std::string ScoreRow(const std::string& name, const ConfusionMatrix& confusion) {
  const LabelScores s = ScoreLabels(confusion);
  return absl::StrFormat("%-34s %12d %8.4f %8.4f %8.4f\n", name, s.counted, s.overall_accuracy, s.average_accuracy,
                         s.mean_iou);
}

nlohmann::ordered_json ScoresOf(const ConfusionMatrix& confusion) {
  const LabelScores s = ScoreLabels(confusion);
  return {{"pixels", s.counted},
          {"overall_accuracy", s.overall_accuracy},
          {"average_accuracy", s.average_accuracy},
          {"mean_iou", s.mean_iou}};
}

}  // namespace

std::string LikelihoodTable(const std::vector<LikelihoodConfusion>& views, const std::vector<std::string>& classes) {
  std::string text =
      absl::StrFormat("%-34s %12s %8s %8s %8s\n", "likeliest class of pixels", "pixels", "OA", "AA", "mIoU");
  for (const LikelihoodConfusion& view : views) text += ScoreRow("  " + view.view, view.likelihoods);
  const auto add = [&](const std::string& name, const ConfusionMatrix& all) {
    text += ScoreRow(name, all);
    const LabelScores scores = ScoreLabels(all);
    for (size_t c = 0; c < classes.size(); ++c) {
      absl::StrAppendFormat(&text, "  %-32s recall %.4f, precision %.4f, IoU %.4f\n", classes[c],
                            scores.classes[c].recall, scores.classes[c].precision, scores.classes[c].iou);
    }
  };
  add("all", Sum(views, classes.size()));
  const ConfusionMatrix mesh = Sum(views, classes.size(), &LikelihoodConfusion::mesh);
  if (mesh.total() > 0) add("all: the mesh's labels there", mesh);
  return text;
}

std::string LikelihoodJson(const std::vector<LikelihoodConfusion>& views, const std::vector<std::string>& classes) {
  const ConfusionMatrix all = Sum(views, classes.size());
  nlohmann::ordered_json json = {{"classes", classes}, {"all", ScoresOf(all)}};
  for (int t = 0; t < all.classes(); ++t) {
    nlohmann::ordered_json row = nlohmann::ordered_json::array();
    for (int r = 0; r < all.classes(); ++r) row.push_back(all.at(t, r));
    json["confusion"].push_back(std::move(row));
  }
  const ConfusionMatrix mesh = Sum(views, classes.size(), &LikelihoodConfusion::mesh);
  if (mesh.total() > 0) json["mesh"] = ScoresOf(mesh);
  for (const LikelihoodConfusion& view : views) json["views"][view.view] = ScoresOf(view.likelihoods);
  return json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace tessera
