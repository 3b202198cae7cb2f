#include "server/display/update_text.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "common/job/task_parameters.h"
#include "server/display/lineage_text.h"
#include "server/display/svg_map.h"

namespace tessera {
namespace {

using nlohmann::json;

constexpr double kBytesPerMiB = 1 << 20, kBytesPerGiB = 1 << 30, kSecondsPerHour = 3600;

template <class Make>
StatusOr<std::string> FromJson(const std::string& text, const Make& make) {
  try {
    return make(json::parse(text));
  } catch (const json::exception& e) {
    return absl::DataLossError(absl::StrCat(kUpdateFile, ": ", e.what()));
  }
}

// Whether the tile itself changed. From scratch, all are refined.
bool IsRedone(const json& tile) { return tile.at("redone") == true; }

// "update of jobs/1: ..."
std::string SummaryLine(const json& plan) {
  const int redone = plan.at("tiles_redone"), tiles = static_cast<int>(plan.at("tiles").size());
  const std::string base = plan.at("base");
  const size_t gone = plan.value("tiles_gone", json::array()).size();
  const std::string without = gone > 0 ? absl::StrCat(", ", gone, " removed: the mesh has no face in them") : "";
  if (plan.at("from_scratch").get<bool>()) {
    return absl::StrFormat(
        "update of %s from scratch: %d of %d tiles changed, all are refined from the start mesh again%s", base, redone,
        tiles, without);
  }
  return absl::StrFormat("update of %s: %d of %d tiles refined, %d kept byte for byte%s", base, redone, tiles,
                         tiles - redone, without);
}

std::string Reasons(const json& tile) {
  std::vector<std::string> reasons;
  for (const json& why : tile.at("why")) reasons.push_back(ReasonText(why.at("reason"), why.at("images")));
  return absl::StrJoin(reasons, "; ");
}

double PredictedSeconds(const json& tile) { return tile.at("predicted").at("core_seconds").get<double>(); }

}  // namespace

StatusOr<std::string> UpdateTable(const std::string& text, const PlanTerms& terms) {
  return FromJson(text, [&](const json& plan) {
    std::string out = absl::StrFormat("%6s %12s %9s  %s\n", "tile", "core-seconds", "MiB", "reason");
    for (const json& tile : plan.at("tiles")) {
      if (!IsRedone(tile)) continue;
      absl::StrAppendFormat(&out, "%6d %12.1f %9.0f  %s\n", tile.at("tile").get<int>(), PredictedSeconds(tile),
                            tile.at("predicted").at("peak_bytes").get<double>() / kBytesPerMiB, Reasons(tile));
    }
    const json& predicted = plan.at("predicted");
    const double seconds = predicted.at("core_seconds"), in_full = predicted.at("core_seconds_in_full");
    absl::StrAppend(&out, SummaryLine(plan), "\n");
    absl::StrAppendFormat(&out, "core-hours: %s%.3f of %.3f for a full job (%.1f %%)\n",
                          plan.at("from_scratch").get<bool>() ? "at most " : "", seconds / kSecondsPerHour,
                          in_full / kSecondsPerHour, in_full > 0 ? 100 * seconds / in_full : 0);
    absl::StrAppendFormat(&out, "disk: %s%.2f GiB of %.2f for a full job\n",
                          plan.at("from_scratch").get<bool>() ? "at most " : "",
                          predicted.at("stored_bytes").get<double>() / kBytesPerGiB,
                          predicted.at("stored_bytes_in_full").get<double>() / kBytesPerGiB);
    if (terms.price_per_core_hour) {
      absl::StrAppendFormat(&out, "price: %.2f of %.2f for a full job\n",
                            *terms.price_per_core_hour * seconds / kSecondsPerHour,
                            *terms.price_per_core_hour * in_full / kSecondsPerHour);
    }
    return out;
  });
}

StatusOr<std::string> UpdateSummary(const std::string& text) { return FromJson(text, SummaryLine); }

StatusOr<std::string> UpdateMap(const std::string& text) {
  return FromJson(text, [](const json& plan) {
    const double cell_m = plan.at("cell_m");
    SvgMap map;
    for (const json& tile : plan.at("tiles")) {
      const auto corner = [&](int i) { return tile.at("core").at(i).get<double>() * cell_m; };
      const std::string why = IsRedone(tile) ? absl::StrFormat("%.0f core-seconds", PredictedSeconds(tile))
                              : tile.at("redone").is_null() ? "refined if it depends on a changed tile"
                                                            : "kept";
      map.tiles.push_back({corner(0), corner(1), corner(2), corner(3), IsRedone(tile) ? "#d6604d" : "#f4efe4",
                           absl::StrFormat("tile %d: %s", tile.at("tile").get<int>(), why)});
    }
    for (const json& camera : plan.at("cameras")) {
      map.cameras.push_back({camera.at("at").at(0), camera.at("at").at(1),
                             camera.at("state") == "new"         ? "fill=\"#06c\""
                             : camera.at("state") == "withdrawn" ? "fill=\"none\" stroke=\"#c00\""
                                                                 : "fill=\"none\" stroke=\"#888\""});
    }
    map.caption = absl::StrCat(SummaryLine(plan), " (red); dots: new cameras");
    return ToSvg(map);
  });
}

}  // namespace tessera
