#include "server/display/lineage_text.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/time/time.h"
#include "common/base/printable.h"
#include "server/client/job_text.h"

namespace tessera {
namespace {

using Json = nlohmann::ordered_json;

std::string UtcTime(int64_t unix_s, const char* format) {
  return unix_s > 0 ? absl::FormatTime(format, absl::FromUnixSeconds(unix_s), absl::UTCTimeZone()) : "-";
}

std::string OrDash(const std::string& text) { return text.empty() ? "-" : text; }

std::string JobLabel(const LineageJob& job) {
  return job.display_name.empty() ? job.name : absl::StrCat(job.name, " (", job.display_name, ")");
}

std::string CoreText(const CellRect& core) {
  return absl::StrFormat("%d,%d..%d,%d", core.x0, core.y0, core.x1, core.y1);
}

// "spring 34, next 12".
std::string ImagesText(const TileLineage& tile) {
  if (!tile.images) return "not stored";
  std::vector<std::string> words;
  for (const FlightImages& flight : *tile.images) {
    words.push_back(
        absl::StrCat(flight.flight.empty() ? "images" : Printable(flight.flight), " ", flight.images.size()));
  }
  return words.empty() ? "none" : absl::StrJoin(words, ", ");
}

// The action of one job of the chain on a tile.
struct TileAction {
  bool made = false;
  bool from_start = false;                           // refined from the start mesh
  bool rolled_back = false;                          // restored from job.rollback_to
  const std::vector<RedoReason>* reasons = nullptr;  // of an update; null: no image is the reason
};

TileAction ActionOf(const LineageJob& job, int tile) {
  TileAction action;
  action.made = job.made.contains(tile);
  action.from_start = action.made && (job.base.empty() || job.from_scratch);
  action.rolled_back = job.rolled_back.contains(tile);
  if (const auto it = job.redos.find(tile); action.made && it != job.redos.end()) action.reasons = &it->second;
  return action;
}

std::string ReasonsText(const std::vector<RedoReason>& reasons) {
  return absl::StrJoin(reasons, "; ", [](std::string* out, const RedoReason& reason) {
    absl::StrAppend(out, ReasonText(reason.reason, reason.images));
  });
}

std::string ActionText(const LineageJob& job, int tile) {
  const TileAction action = ActionOf(job, tile);
  if (action.rolled_back) return "restored from " + job.rollback_to;
  if (!action.made) return "kept from " + job.base;
  std::string words = job.base.empty()    ? "made from the start mesh"
                      : action.from_start ? "redone from the start mesh"
                                          : "redone from " + job.base;
  if (action.reasons != nullptr) words += " because: " + ReasonsText(*action.reasons);
  return words;
}

Json TileJson(const Lineage& lineage, const TileLineage& tile) {
  const CellRect& core = tile.tile.core;
  Json history = Json::array();
  for (const LineageJob& job : lineage.chain) {
    const TileAction action = ActionOf(job, tile.tile.tile);
    const char* const did = action.rolled_back ? "rolled back"
                            : !action.made     ? "kept"
                            : job.base.empty() ? "made"
                                               : "redone";
    Json entry = {{"job", job.name}, {"did", did}};
    if (action.rolled_back) entry["to"] = job.rollback_to;
    if (action.made) entry["from_start"] = action.from_start;
    if (action.reasons != nullptr) {
      entry["why"] = Json::array();
      for (const RedoReason& why : *action.reasons)
        entry["why"].push_back({{"reason", why.reason}, {"images", why.images}});
    }
    history.push_back(std::move(entry));
  }
  Json flights = nullptr;
  if (tile.images) {
    flights = Json::array();
    for (const FlightImages& flight : *tile.images) {
      flights.push_back({{"flight", flight.flight}, {"date", flight.date}, {"images", flight.images}});
    }
  }
  return {{"tile", tile.tile.tile},
          {"core", {core.x0, core.y0, core.x1, core.y1}},
          {"made_by", lineage.chain[tile.made_by].name},
          {"state_sha256", tile.state.sha256},
          {"flights", std::move(flights)},
          {"history", std::move(history)}};
}

StatusOr<const TileLineage*> FindTile(const Lineage& lineage, int tile) {
  const auto it = std::find_if(lineage.tiles.begin(), lineage.tiles.end(),
                               [&](const TileLineage& one) { return one.tile.tile == tile; });
  if (it != lineage.tiles.end()) return &*it;
  return absl::InvalidArgumentError(absl::StrCat("--tile: found ", tile, ", expected one of the ", lineage.tiles.size(),
                                                 " tiles of ", lineage.chain.front().name, ", numbered from 0"));
}

}  // namespace

std::string ReasonText(const std::string& reason, const std::vector<std::string>& images) {
  if (images.empty()) return reason;
  return absl::StrCat(reason, ": ", images.size(), " (", images.front(), images.size() > 1 ? ", ..." : "", ")");
}

std::string LineageTable(const Lineage& lineage) {
  using Row = std::vector<std::string>;
  std::vector<Row> rows = {{"TILE", "CORE", "MADE BY", "FINISHED", "VERSION", "METHOD", "IMAGES", "STATE"}};
  for (const TileLineage& tile : lineage.tiles) {
    const LineageJob& job = lineage.chain[tile.made_by];
    rows.push_back({absl::StrCat(tile.tile.tile), CoreText(tile.tile.core), JobLabel(job),
                    UtcTime(job.finished_s, "%Y-%m-%d"), OrDash(job.algorithm_version), OrDash(job.method),
                    ImagesText(tile), tile.state.sha256});
  }
  return ColumnsText(rows);
}

StatusOr<std::string> TileLineageText(const Lineage& lineage, int id, bool with_images) {
  TESSERA_ASSIGN_OR_RETURN(const TileLineage* const tile, FindTile(lineage, id));
  const LineageJob& maker = lineage.chain[tile->made_by];
  std::string out = absl::StrFormat(
      "tile %d of %s, cells %s\nmade by %s, finished %s, method %s, algorithm version %s\nstate %s\nimages: "
      "%s\n",
      id, JobLabel(lineage.chain.front()), CoreText(tile->tile.core), JobLabel(maker),
      UtcTime(maker.finished_s, "%Y-%m-%d %H:%M:%S UTC"), OrDash(maker.method), OrDash(maker.algorithm_version),
      tile->state.sha256, ImagesText(*tile));
  const char* arrow = "   ";
  for (const LineageJob& job : lineage.chain) {
    absl::StrAppend(&out, arrow, JobLabel(job), ": ", ActionText(job, id), "\n");
    arrow = "<- ";
  }
  if (!with_images || !tile->images) return out;
  for (const FlightImages& flight : *tile->images) {
    absl::StrAppend(&out, "flight ", OrDash(Printable(flight.flight)), flight.date.empty() ? "" : ", ",
                    Printable(flight.date), "\n");
    for (const std::string& image : flight.images) absl::StrAppend(&out, "  ", Printable(image), "\n");
  }
  return out;
}

StatusOr<std::string> LineageJson(const Lineage& lineage, int only) {
  Json chain = Json::array(), tiles = Json::array();
  for (const LineageJob& job : lineage.chain) {
    chain.push_back(
        {{"job", job.name},
         {"display_name", job.display_name},
         {"base", job.base.empty() ? Json(nullptr) : Json(job.base)},
         {"finished", job.finished_s > 0 ? Json(UtcTime(job.finished_s, "%Y-%m-%dT%H:%M:%SZ")) : Json(nullptr)},
         {"algorithm_version", job.algorithm_version.empty() ? Json(nullptr) : Json(job.algorithm_version)},
         {"method", job.method}});
  }
  if (only >= 0) {
    TESSERA_ASSIGN_OR_RETURN(const TileLineage* const tile, FindTile(lineage, only));
    tiles.push_back(TileJson(lineage, *tile));
  } else {
    for (const TileLineage& tile : lineage.tiles) tiles.push_back(TileJson(lineage, tile));
  }
  const Json json = {{"tessera_lineage", 1},
                     {"job", lineage.chain.front().name},
                     {"chain", std::move(chain)},
                     {"tiles", std::move(tiles)}};
  return json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";  // names may not be UTF-8
}

}  // namespace tessera
