#include "server/display/run_summary.h"

#include <nlohmann/json.hpp>
#include <optional>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "server/client/job_text.h"
#include "server/display/update_text.h"

namespace tessera {
namespace {

nlohmann::json ReadJson(const std::string& path) {
  const auto text = ReadFile(path);
  return text.ok() ? nlohmann::json::parse(*text, nullptr, /*allow_exceptions=*/false)
                   : nlohmann::json(nlohmann::json::value_t::discarded);
}

// The number at a JSON pointer; nullopt if there is none.
std::optional<double> NumberAt(const nlohmann::json& json, const char* pointer) {
  const nlohmann::json::json_pointer path(pointer);
  if (!json.is_structured() || !json.contains(path) || !json[path].is_number()) return std::nullopt;
  return json[path].get<double>();
}

struct Energies {
  double before = 0, after = 0;
};

// Photo energy (1 - ZNCC, robust mean) at the finest level's first step of the first round and last of the last: the
// tiles' means, weighted by their pixels.
std::optional<Energies> EnergyOfTiles(const nlohmann::json& report) {
  if (!report.is_object() || !report.contains("tiles")) return std::nullopt;
  Energies sum;
  double weights = 0;
  for (const nlohmann::json& tile : report["tiles"]) {
    if (!tile.is_object() || !tile.contains("rounds")) continue;
    const nlohmann::json& rounds = tile["rounds"];
    if (!rounds.is_array() || rounds.empty()) continue;
    const auto first = NumberAt(rounds.front(), "/photo_energy_start"),
               last = NumberAt(rounds.back(), "/photo_energy_end"), pixels = NumberAt(rounds.front(), "/warped_pixels");
    if (!first || !last || !pixels) continue;
    sum.before += *pixels * *first;
    sum.after += *pixels * *last;
    weights += *pixels;
  }
  if (weights <= 0) return std::nullopt;
  return Energies{sum.before / weights, sum.after / weights};
}

std::string Count(double value) { return FormatThousands(static_cast<long long>(value)); }
std::string Short(double value) { return absl::StrFormat("%.6g", value); }

}  // namespace

std::vector<std::string> RunSummary(const std::string& out) {
  std::vector<std::string> lines;
  const nlohmann::json report = ReadJson(out + "/report.json");
  const auto faces = NumberAt(report, "/output/faces"), vertices = NumberAt(report, "/output/vertices");
  if (faces && vertices) {
    lines.push_back(absl::StrCat("mesh: ", Count(*faces), " faces, ", Count(*vertices), " vertices, ",
                                 report.contains("tiles") ? report["tiles"].size() : 1, " tiles"));
  }
  if (const auto energy = EnergyOfTiles(report)) {
    lines.push_back(absl::StrCat("photo energy (1 - ZNCC, robust mean): ", Short(energy->before),
                                 " at the finest level's first step, ", Short(energy->after), " at its last"));
  }
  const auto patches = NumberAt(report, "/fit_change/patches"),
             fit_before = NumberAt(report, "/fit_change/above_chance_start"),
             fit_after = NumberAt(report, "/fit_change/above_chance_result");
  if (patches && fit_before && fit_after && *patches > 0) {
    lines.push_back(absl::StrFormat("fit of images: %.1f %% of %s patches match at the start, %.1f %% in the result",
                                    100 * *fit_before, Count(*patches), 100 * *fit_after));
  }
  if (const auto moved_m = NumberAt(report, "/displacement/rms_m")) {
    lines.push_back(absl::StrCat("moved: ", Short(*moved_m), " m rms"));
  }
  if (const auto changed = NumberAt(report, "/label_changes"); changed && faces.value_or(0) > 0) {
    lines.push_back(absl::StrFormat("labels changed: %s faces, %.1f %%", Count(*changed), 100 * *changed / *faces));
  }
  const auto samples = NumberAt(report, "/seams/samples"), different = NumberAt(report, "/seams/different"),
             farthest_m = NumberAt(report, "/seams/farthest_m");
  if (samples && different && farthest_m && *samples > 0) {
    lines.push_back(absl::StrCat("seams: ", Count(*different), " of ", Count(*samples), " samples differ"));
    if (*different > 0) {
      absl::StrAppend(&lines.back(), ", by ", Short(*farthest_m), " m at most, in tiles ",
                      report["seams"]["tiles"].dump());
    }
  }
  if (const auto plan = ReadFile(out + "/" + kUpdateFile); plan.ok()) {
    if (const auto words = UpdateSummary(*plan); words.ok()) lines.push_back(*words);
  }
  const nlohmann::json job = ReadJson(out + "/job.json");
  const auto tasks = NumberAt(job, "/totals/tasks"), reused = NumberAt(job, "/totals/reused");
  if (tasks && reused)
    lines.push_back(absl::StrCat("tasks: ", Count(*tasks), ", of which ", Count(*reused), " reused"));
  return lines;
}

bool ResultIsWorse(const std::string& out) {
  const nlohmann::json report = ReadJson(out + "/report.json");
  const nlohmann::json::json_pointer worse("/fit_change/worse");
  return report.is_object() && report.contains(worse) && report[worse] == true;
}

}  // namespace tessera
