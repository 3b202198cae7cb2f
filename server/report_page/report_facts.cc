#include "server/report_page/report_facts.h"

#include <nlohmann/json.hpp>

#include "common/base/json_bounds.h"

namespace tessera {
namespace {

using nlohmann::json;

// The value at a JSON pointer; null if there is none.
const json& ValueAt(const json& value, const char* pointer) {
  static const json kNull;
  const json::json_pointer path(pointer);
  return value.is_structured() && value.contains(path) ? value[path] : kNull;
}

std::optional<double> NumberAt(const json& value, const char* pointer) {
  const json& found = ValueAt(value, pointer);
  return found.is_number() ? std::optional(found.get<double>()) : std::nullopt;
}

std::string TextAt(const json& value, const char* pointer) {
  const json& found = ValueAt(value, pointer);
  return found.is_string() ? found.get<std::string>() : "";
}

// Its elements; none if it is no array.
std::vector<json> ListAt(const json& value, const char* pointer) {
  const json& found = ValueAt(value, pointer);
  return found.is_array() ? found.get<std::vector<json>>() : std::vector<json>();
}

std::optional<FitFacts> FitAt(const json& value, const char* pointer) {
  const json& fit = ValueAt(value, pointer);
  const auto patches = NumberAt(fit, "/patches"), start = NumberAt(fit, "/above_chance_start"),
             result = NumberAt(fit, "/above_chance_result");
  if (!patches || !start || !result || !(*patches > 0)) return std::nullopt;
  return FitFacts{*patches, *start, *result, ValueAt(fit, "/worse") == true};
}

std::vector<std::pair<std::string, double>> SharesAt(const json& value, const char* pointer) {
  std::vector<std::pair<std::string, double>> shares;
  const json& found = ValueAt(value, pointer);
  if (!found.is_object()) return shares;
  for (const auto& [name, share] : found.items()) {
    if (share.is_number()) shares.emplace_back(name, share.get<double>());
  }
  return shares;
}

TileFacts TileOf(const json& value) {
  TileFacts tile;
  const double id = NumberAt(value, "/tile").value_or(-1);
  if (id >= 0 && id < 1e9) tile.tile = static_cast<int>(id);
  tile.faces = NumberAt(value, "/faces");
  tile.views = NumberAt(value, "/views");
  tile.first_label_changes = NumberAt(value, "/labels_first/label_changes");
  tile.fit = FitAt(value, "/fit");
  tile.quarantined = ValueAt(value, "/quarantined") == true;
  for (const json& round : ListAt(value, "/rounds")) {
    tile.rounds.push_back({NumberAt(round, "/photo_energy_start"), NumberAt(round, "/photo_energy_end"),
                           NumberAt(round, "/label_changes"), NumberAt(round, "/warped_pixels").value_or(0)});
  }
  return tile;
}

}  // namespace

StatusOr<ReportFacts> ParseReportFacts(const std::string& report_json) {
  if (const Status depth = CheckJsonDepth("report.json", report_json); !depth.ok()) {
    return absl::DataLossError(std::string(depth.message()));
  }
  const json report = json::parse(report_json, nullptr, /*allow_exceptions=*/false);
  if (!report.is_object()) return absl::DataLossError("report.json: found no JSON object, expected the report");
  ReportFacts facts;
  facts.scene = TextAt(report, "/scene");
  facts.input_faces = NumberAt(report, "/input/faces");
  facts.input_vertices = NumberAt(report, "/input/vertices");
  facts.faces = NumberAt(report, "/output/faces");
  facts.vertices = NumberAt(report, "/output/vertices");
  facts.views = NumberAt(report, "/views");
  facts.gsd_m = NumberAt(report, "/gsd_m");
  facts.label_changes = NumberAt(report, "/label_changes");
  facts.rms_m = NumberAt(report, "/displacement/rms_m");
  facts.median_m = NumberAt(report, "/displacement/median_m");
  facts.p90_m = NumberAt(report, "/displacement/p90_m");
  facts.max_m = NumberAt(report, "/displacement/max_m");
  facts.seam_samples = NumberAt(report, "/seams/samples");
  facts.seam_different = NumberAt(report, "/seams/different");
  facts.seam_farthest_m = NumberAt(report, "/seams/farthest_m");
  facts.fit = FitAt(report, "/fit_change");
  for (const json& name : ListAt(report, "/classes")) {
    facts.classes.push_back(name.is_string() ? name.get<std::string>() : "");
  }
  facts.shares_before = SharesAt(report, "/area_share_before");
  facts.shares_after = SharesAt(report, "/area_share_after");
  for (const json& tile : ListAt(report, "/tiles")) facts.tiles.push_back(TileOf(tile));
  for (const json& warning : ListAt(report, "/warnings")) {
    if (warning.is_string()) facts.warnings.push_back(warning.get<std::string>());
  }
  for (const json& image : ListAt(report, "/skipped_images")) {
    facts.skipped_images.emplace_back(TextAt(image, "/name"), TextAt(image, "/reason"));
  }
  if (const json& frame = ValueAt(report, "/frame"); frame.is_object()) {
    facts.frame = frame.dump(-1, ' ', false, json::error_handler_t::replace);
  }
  return facts;
}

}  // namespace tessera
