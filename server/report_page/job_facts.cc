#include "server/report_page/job_facts.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/base/json_bounds.h"

namespace tessera {
namespace {

using Json = nlohmann::ordered_json;

std::string FactText(const Json& json, const char* key) {
  const auto found = json.find(key);
  return found != json.end() && found->is_string() ? found->get<std::string>() : "";
}

std::optional<double> FactNumber(const Json& json, const char* key) {
  const auto found = json.find(key);
  return found != json.end() && found->is_number() ? std::optional(found->get<double>()) : std::nullopt;
}

const Json& FactObject(const Json& json, const char* key) {
  static const Json kEmpty = Json::object();
  const auto found = json.find(key);
  return found != json.end() && found->is_object() ? *found : kEmpty;
}

const Json& FactList(const Json& json, const char* key) {
  static const Json kEmpty = Json::array();
  const auto found = json.find(key);
  return found != json.end() && found->is_array() ? *found : kEmpty;
}

// The tile's number; -1 if there is none.
int FactTile(const Json& json) {
  const double tile = FactNumber(json, "tile").value_or(-1);
  return tile >= 0 && tile < 1e9 ? static_cast<int>(tile) : -1;
}

void AddTask(const Json& task, MeasuredTasks* to) {
  ++to->tasks;
  for (const Json& run : FactList(task, "runs")) {
    if (run.is_object()) to->attempts_s += FactNumber(run, "seconds").value_or(0);
  }
  const Json &used = FactObject(task, "used"), &predicted = FactObject(task, "predicted");
  if (const double core_s = FactNumber(used, "core_seconds").value_or(0); core_s > 0) {
    to->used_core_s += core_s;
    to->predicted_core_s += FactNumber(predicted, "core_seconds").value_or(0);
  }
  if (const double bytes = FactNumber(used, "peak_bytes").value_or(0); bytes > 0) {
    to->used_peak_bytes = std::max(to->used_peak_bytes, bytes);
    to->predicted_peak_bytes = std::max(to->predicted_peak_bytes, FactNumber(predicted, "peak_bytes").value_or(0));
  }
}

void AddSettings(const Json& settings, JobFacts* facts) {
  for (const auto& [name, value] : settings.items()) {
    if (value.is_object()) {
      AddSettings(value, facts);
    } else {
      facts->settings.emplace_back(name, value.is_string()
                                             ? value.get<std::string>()
                                             : value.dump(-1, ' ', false, Json::error_handler_t::replace));
    }
  }
}

void AddHead(const Json& head, JobFacts* facts) {
  facts->name = FactText(head, "name");
  facts->display_name = FactText(head, "display_name");
  facts->scene = FactText(head, "scene");
  facts->state = FactText(head, "state");
  facts->error = FactText(head, "error");
  facts->algorithm_version = FactText(head, "algorithm_version");
  facts->base = FactText(head, "base");
  const Json& rollback = FactObject(head, "rollback");
  facts->rollback_to = FactText(rollback, "to");
  for (const Json& tile : FactList(rollback, "tiles")) {
    if (tile.is_number_integer()) facts->rollback_tiles.push_back(tile.get<int>());
  }
  AddSettings(FactObject(head, "settings"), facts);
  for (const Json& warning : FactList(head, "warnings")) {
    if (warning.is_string()) facts->warnings.push_back(warning.get<std::string>());
  }
  for (const Json& tile : FactList(head, "quarantined")) {
    if (!tile.is_object()) continue;
    facts->quarantined.emplace_back(FactTile(tile), FactText(tile, "why"));
  }
  const Json& totals = FactObject(head, "totals");
  facts->seconds = FactNumber(totals, "seconds");
  facts->tasks = FactNumber(totals, "tasks");
  facts->attempts = FactNumber(totals, "attempts");
  facts->reused = FactNumber(totals, "reused");
}

}  // namespace

StatusOr<JobFacts> ParseJobFacts(std::string_view job_json) {
  if (const Status depth = CheckJsonDepth("job.json", job_json); !depth.ok()) {
    return absl::DataLossError(std::string(depth.message()));
  }
  JobFacts facts;
  std::string section;  // top-level key being parsed
  const auto take = [&](int depth, Json::parse_event_t event, Json& value) {
    if (depth == 1 && event == Json::parse_event_t::key) section = value.get<std::string>();
    if (depth != 2 || event != Json::parse_event_t::object_end || section != "tasks") return true;
    AddTask(value, &facts.kinds[FactText(value, "kind")]);
    if (const int tile = FactTile(value); tile >= 0) AddTask(value, &facts.tiles[tile]);
    return false;  // discard the parsed task
  };
  const Json head = Json::parse(job_json.begin(), job_json.end(), take, /*allow_exceptions=*/false);
  if (!head.is_object()) return absl::DataLossError("job.json: found no JSON object, expected the job");
  AddHead(head, &facts);
  return facts;
}

}  // namespace tessera
