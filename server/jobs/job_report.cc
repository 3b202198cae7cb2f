#include "server/jobs/job_report.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "common/base/json_bounds.h"

namespace tessera {
namespace {

using Json = nlohmann::ordered_json;

double Seconds(int64_t from_us, int64_t to_us) {
  return from_us > 0 && to_us > from_us ? static_cast<double>(to_us - from_us) / 1e6 : 0;
}

const char* Name(TaskState state) {
  switch (state) {
    case TaskState::kWaiting:
      return "waiting";
    case TaskState::kReady:
      return "ready";
    case TaskState::kLeased:
      return "running";
    case TaskState::kSucceeded:
      return "succeeded";
    case TaskState::kFailed:
      return "failed";
    case TaskState::kCancelled:
      return "cancelled";
  }
  return "unknown";
}

const char* Name(JobState end) {
  return end == JobState::kSucceeded ? "succeeded" : end == JobState::kPartial ? "partial" : "failed";
}

// Null if the text is no JSON or too deep: earlier releases did not limit the depth.
Json ParseStored(const std::string& text) {
  if (!CheckJsonDepth("", text).ok()) return nullptr;
  Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  return json.is_discarded() ? Json(nullptr) : std::move(json);
}

Json TaskJson(const JobTask& task, int64_t end_us) {
  Json json = {{"kind", task.plan.kind.str()}, {"title", task.plan.name}, {"tile", task.plan.tile},
               {"state", Name(task.state)},    {"reused", task.reused},   {"attempts", task.attempt()},
               {"worker", task.worker()},      {"key", task.key_hex()}};
  if (task.superseded) json["superseded"] = true;
  double seconds = 0;
  Json runs = Json::array();
  for (const Attempt& attempt : task.attempts) {
    const double run_s = Seconds(attempt.start_us, attempt.end_us > 0 ? attempt.end_us : end_us);
    seconds = run_s;
    Json run = {{"worker", attempt.worker.str()}, {"seconds", run_s}};
    if (attempt.failure->error_class != ErrorClass::kNone) {
      run["error_class"] = attempt.lease_expired ? "lease expired" : ErrorClassName(attempt.failure->error_class);
      run["error"] = attempt.failure->message;
    }
    runs.push_back(std::move(run));
  }
  json["seconds"] = seconds;
  json["predicted"] = {
      {"core_seconds", task.plan.cost}, {"peak_bytes", task.plan.peak_bytes}, {"stored_bytes", task.plan.stored_bytes}};
  if (task.state == TaskState::kSucceeded && !task.reused) {
    json["used"] = {{"core_seconds", task.usage.core_seconds},
                    {"peak_bytes", task.usage.peak_bytes},
                    {"threads", task.usage.threads}};
  }
  json["runs"] = std::move(runs);
  json["parameters"] = ParseStored(task.plan.parameters);
  json["stats"] = ParseStored(task.stats);
  Json outputs = Json::object();
  for (const StoredFile& output : task.outputs) {
    outputs[output.name.str()] = {{"sha256", output.sha256.Hex()}, {"size_bytes", output.size_bytes}};
  }
  json["outputs"] = std::move(outputs);
  if (!task.warnings->empty()) json["warnings"] = *task.warnings;
  return json;
}

// Adds the seconds of each stage from the task's statistics, and the rest of the lease as "dispatch".
void AddStages(const JobTask& task, std::map<std::string, double>* seconds_of_stage) {
  if (task.state != TaskState::kSucceeded || task.reused) return;
  const Json stats = ParseStored(task.stats);
  if (!stats.is_object()) return;
  constexpr std::string_view kPrefix = "seconds_";
  for (const auto& [name, value] : stats.items()) {
    if (value.is_number() && name.starts_with(kPrefix)) {
      (*seconds_of_stage)[name.substr(kPrefix.size())] += value.get<double>();
    }
  }
  const auto own = stats.find("seconds");
  if (own == stats.end() || !own->is_number() || task.attempts.empty()) return;
  const Attempt& last = task.attempts.back();
  (*seconds_of_stage)["dispatch"] += std::max(0.0, Seconds(last.start_us, last.end_us) - own->get<double>());
}

// File names may not be UTF-8.
std::string Dump(const Json& json, int indent = 1) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

}  // namespace

JobReport::JobReport(JobHeader header, JobState end, std::string error, std::map<int, std::string> quarantined,
                     int64_t end_us)
    : header_(std::move(header)),
      end_(end),
      error_(std::move(error)),
      quarantined_(std::move(quarantined)),
      end_us_(end_us) {}

void JobReport::Count(const JobTask& task) {
  const std::string& kind = task.plan.kind;
  ++tasks_;
  attempts_ += task.attempt();
  reused_ += task.reused ? 1 : 0;
  ++tasks_of_kind_[kind];
  if (!task.reused) core_seconds_of_kind_[kind] += task.usage.core_seconds;
  AddStages(task, &seconds_of_stage_);
  for (const Attempt& attempt : task.attempts) {
    const double run_s = Seconds(attempt.start_us, attempt.end_us > 0 ? attempt.end_us : end_us_);
    seconds_of_kind_[kind] += run_s;
    seconds_of_worker_[attempt.worker] += run_s;
  }
}

std::string JobReport::Head() const {
  const JobSettings& settings = header_.settings;
  Json json = {{"tessera_job", 1},
               {"name", header_.name},
               {"display_name", header_.display_name},
               {"scene", header_.scene_path},
               {"algorithm_version", header_.algorithm_version},
               {"base", settings.update.base.empty() ? Json(nullptr) : Json(settings.update.base)},
               {"settings",
                {{"tiles", settings.tiles},
                 {"tile_memory_bytes", settings.tile_memory_bytes},
                 {"rounds", settings.rounds},
                 {"method", settings.method},
                 {"from_scratch", settings.update.from_scratch},
                 {"method_settings", Json::parse(ToJson(settings.method_settings))}}},
               {"state", Name(end_)}};
  if (!settings.classifier.empty()) json["settings"]["classifier"] = settings.classifier;
  if (!settings.exports.formats.empty()) {
    const ExportSettings& exports = settings.exports;
    json["settings"]["export"] = {{"formats", exports.formats},
                                  {"crs", exports.crs},
                                  {"color", exports.color},
                                  {"gsd_m", exports.gsd_m},
                                  {"class_materials", exports.class_materials}};
  }
  if (const UpdateSettings& update = settings.update; !update.rollback_to.empty()) {
    json["rollback"] = {{"to", update.rollback_to}, {"tiles", update.rollback_tiles}};
  }
  if (!error_.empty()) json["error"] = error_;
  json["warnings"] = header_.warnings;
  for (const auto& [tile, why] : quarantined_) json["quarantined"].push_back({{"tile", tile}, {"why", why}});
  json["totals"] = {{"seconds", Seconds(header_.create_us, end_us_)},
                    {"tasks", tasks_},
                    {"attempts", attempts_},
                    {"reused", reused_},
                    {"tasks_of_kind", tasks_of_kind_},
                    {"seconds_of_kind", seconds_of_kind_},
                    {"core_seconds_of_kind", core_seconds_of_kind_},
                    {"seconds_of_stage", seconds_of_stage_},
                    {"seconds_of_worker", seconds_of_worker_}};
  std::string text = Dump(json);
  text.pop_back();  // removes the newline and the closing brace
  text.pop_back();
  return text + ",\n \"tasks\": [";
}

std::string JobReport::Line(const JobTask& task) {
  return (std::exchange(has_line_, true) ? ",\n  " : "\n  ") + Dump(TaskJson(task, end_us_), -1);
}

}  // namespace tessera
