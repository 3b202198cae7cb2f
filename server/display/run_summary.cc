#include "server/display/run_summary.h"

#include <cstdio>
#include <nlohmann/json.hpp>

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

// Reads the number at a JSON pointer; false if there is none.
bool FindNumber(const nlohmann::json& json, const std::string& pointer, double* value) {
  const nlohmann::json::json_pointer path(pointer);
  if (!json.is_structured() || !json.contains(path) || !json[path].is_number()) return false;
  *value = json[path].get<double>();
  return true;
}

// Photo energy (1 - ZNCC, robust mean) at the finest level's first step of the first round and last of the last: the
// tiles' means, weighted by their pixels.
bool EnergyOfTiles(const nlohmann::json& report, double* before, double* after) {
  if (!report.is_object() || !report.contains("tiles")) return false;
  double weights = 0;
  for (const nlohmann::json& tile : report["tiles"]) {
    const nlohmann::json::json_pointer rounds_path("/rounds");
    const nlohmann::json rounds =
        tile.is_object() && tile.contains(rounds_path) ? tile[rounds_path] : nlohmann::json::array();
    if (!rounds.is_array() || rounds.empty()) continue;
    double first = 0, last = 0, pixels = 0;
    if (!FindNumber(rounds.front(), "/photo_energy_start", &first)) continue;
    if (!FindNumber(rounds.back(), "/photo_energy_end", &last)) continue;
    if (!FindNumber(rounds.front(), "/warped_pixels", &pixels)) continue;
    *before += pixels * first;
    *after += pixels * last;
    weights += pixels;
  }
  if (weights <= 0) return false;
  *before /= weights;
  *after /= weights;
  return true;
}

std::string PercentText(double share) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.1f %%", 100 * share);
  return text;
}

std::string Short(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.6g", value);
  return text;
}

}  // namespace

std::vector<std::string> RunSummary(const std::string& out) {
  std::vector<std::string> lines;
  const nlohmann::json report = ReadJson(out + "/report.json");
  double faces = 0, vertices = 0, changed = 0, moved_m = 0, before = 0, after = 0;
  if (FindNumber(report, "/output/faces", &faces) && FindNumber(report, "/output/vertices", &vertices)) {
    lines.push_back("mesh: " + FormatThousands(static_cast<long long>(faces)) + " faces, " +
                    FormatThousands(static_cast<long long>(vertices)) + " vertices, " +
                    std::to_string(report.contains("tiles") ? report["tiles"].size() : 1) + " tiles");
  }
  if (EnergyOfTiles(report, &before, &after)) {
    lines.push_back("photo energy (1 - ZNCC, robust mean): " + Short(before) + " at the finest level's first step, " +
                    Short(after) + " at its last");
  }
  if (FindNumber(report, "/displacement/rms_m", &moved_m)) lines.push_back("moved: " + Short(moved_m) + " m rms");
  if (FindNumber(report, "/label_changes", &changed) && faces > 0) {
    lines.push_back("labels changed: " + FormatThousands(static_cast<long long>(changed)) + " faces, " +
                    PercentText(changed / faces));
  }
  double samples = 0, different = 0, farthest_m = 0;
  if (FindNumber(report, "/seams/samples", &samples) && FindNumber(report, "/seams/different", &different) &&
      FindNumber(report, "/seams/farthest_m", &farthest_m) && samples > 0) {
    lines.push_back("seams: " + FormatThousands(static_cast<long long>(different)) + " of " +
                    FormatThousands(static_cast<long long>(samples)) + " samples differ" +
                    (different > 0
                         ? ", by " + Short(farthest_m) + " m at most, in tiles " + report["seams"]["tiles"].dump()
                         : std::string()));
  }
  if (const auto plan = ReadFile(out + "/" + kUpdateFile); plan.ok()) {
    if (const auto words = UpdateSummary(*plan); words.ok()) lines.push_back(*words);
  }
  const nlohmann::json job = ReadJson(out + "/job.json");
  double tasks = 0, reused = 0;
  if (FindNumber(job, "/totals/tasks", &tasks) && FindNumber(job, "/totals/reused", &reused)) {
    lines.push_back("tasks: " + FormatThousands(static_cast<long long>(tasks)) + ", of which " +
                    FormatThousands(static_cast<long long>(reused)) + " reused");
  }
  return lines;
}

}  // namespace tessera
