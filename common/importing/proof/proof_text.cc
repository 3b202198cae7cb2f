#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/importing/proof/proof.h"

namespace tessera {
namespace {

using Json = nlohmann::ordered_json;

Json ResidualsToJson(const ResidualSummary& residuals) {
  return {{"observations", residuals.observations}, {"median_px", residuals.median_px}, {"p95_px", residuals.p95_px}};
}

Json ProofRowsToJson(const std::vector<ProofRow>& rows) {
  Json json = Json::array();
  for (const ProofRow& row : rows) {
    Json& entry = json.emplace_back(Json{{"name", row.name}});
    entry.update(ResidualsToJson(row.residuals));
  }
  return json;
}

Json ProofAlternativesToJson(const std::vector<ProofAlternative>& alternatives) {
  Json json = Json::array();
  for (const ProofAlternative& alternative : alternatives) {
    Json& entry = json.emplace_back(Json{{"name", alternative.name}});
    entry.update(ResidualsToJson(alternative.residuals));
    if (alternative.is_better) entry["better"] = true;
    if (alternative.is_applied) entry["applied"] = true;
  }
  return json;
}

std::string ProofLine(const std::string& name, const ResidualSummary& residuals, const std::string& note) {
  const auto text = [](double px) { return std::isfinite(px) ? absl::StrFormat("%.3f", px) : std::string("behind"); };
  return absl::StrFormat("%12d %10s %10s  %s%s\n", residuals.observations, text(residuals.median_px),
                         text(residuals.p95_px), name, note);
}

}  // namespace

std::string ProofToText(const Proof& proof, size_t most_rows) {
  if (proof.tie_points.observations == 0 && proof.control_points.observations == 0) {
    return "not proven: no tie points\n";
  }
  std::string text = absl::StrFormat("%12s %10s %10s  residuals of\n", "observations", "median px", "95 % px");
  text += ProofLine("tie points", proof.tie_points, proof.is_proven ? "" : ": not proven");
  if (proof.control_points.observations > 0) text += ProofLine("control points", proof.control_points, "");
  for (size_t i = 0; i < std::min(most_rows, proof.cameras.size()); ++i) {
    text += ProofLine(absl::StrCat("camera ", proof.cameras[i].name), proof.cameras[i].residuals, "");
  }
  if (proof.cameras.size() > most_rows) absl::StrAppend(&text, "and ", proof.cameras.size() - most_rows, " cameras\n");
  std::vector<size_t> order(proof.images.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    return proof.images[a].residuals.median_px > proof.images[b].residuals.median_px;
  });
  for (size_t i = 0; i < std::min(most_rows, order.size()); ++i) {
    const bool is_bad = std::find(proof.bad_images.begin(), proof.bad_images.end(), static_cast<int>(order[i])) !=
                        proof.bad_images.end();
    const ProofRow& row = proof.images[order[i]];
    text += ProofLine(absl::StrCat("image ", row.name), row.residuals, is_bad ? ": over three times all" : "");
  }
  if (order.size() > most_rows) absl::StrAppend(&text, "and ", order.size() - most_rows, " better images\n");
  for (const ProofAlternative& reading : proof.readings) {
    text += ProofLine(absl::StrCat("sample, with ", reading.name), reading.residuals,
                      reading.is_applied ? ": applied" : "");
  }
  for (size_t i = 0; i < std::min<size_t>(3, proof.alternatives.size()); ++i) {
    const ProofAlternative& other = proof.alternatives[i];
    text += ProofLine(absl::StrCat("sample, with ", other.name), other.residuals, other.is_better ? ": better" : "");
  }
  return text;
}

std::string ProofToJson(const Proof& proof) {
  Json json;
  json["proven"] = proof.is_proven;
  json["tie_points"] = ResidualsToJson(proof.tie_points);
  json["control_points"] = ResidualsToJson(proof.control_points);
  json["sample"] = ResidualsToJson(proof.sample);
  if (proof.triangulated > 0) json["triangulated_points"] = proof.triangulated;
  if (proof.not_triangulated > 0) json["not_triangulated_points"] = proof.not_triangulated;
  json["cameras"] = ProofRowsToJson(proof.cameras);
  json["images"] = ProofRowsToJson(proof.images);
  for (const int image : proof.bad_images) json["images"][static_cast<size_t>(image)]["bad"] = true;
  json["readings"] = ProofAlternativesToJson(proof.readings);
  json["alternatives"] = ProofAlternativesToJson(proof.alternatives);
  return json.dump(2, ' ', false, Json::error_handler_t::replace);
}

}  // namespace tessera
