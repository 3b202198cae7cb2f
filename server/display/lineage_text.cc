#include "server/display/lineage_text.h"

#include <algorithm>
#include <ctime>
#include <nlohmann/json.hpp>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "common/base/printable.h"

namespace tessera {
namespace {

using Json = nlohmann::ordered_json;

std::string UtcTime(int64_t unix_s, const char* format) {
  if (unix_s <= 0) return "-";
  const time_t time = unix_s;
  tm utc = {};
  gmtime_r(&time, &utc);
  char text[32];
  std::strftime(text, sizeof(text), format, &utc);
  return text;
}

std::string OrDash(const std::string& words) { return words.empty() ? "-" : words; }

std::string JobWords(const LineageJob& job) {
  return job.display_name.empty() ? job.name : absl::StrCat(job.name, " (", job.display_name, ")");
}

std::string CoreWords(const CellRect& core) {
  return absl::StrFormat("%d,%d..%d,%d", core.x0, core.y0, core.x1, core.y1);
}

// "spring 34, next 12".
std::string ImagesWords(const TileLineage& tile) {
  if (!tile.images) return "not stored";
  std::vector<std::string> words;
  for (const FlightImages& flight : *tile.images) {
    words.push_back(
        absl::StrCat(flight.flight.empty() ? "images" : Printable(flight.flight), " ", flight.images.size()));
  }
  return words.empty() ? "none" : absl::StrJoin(words, ", ");
}

// What one job of the chain did about a tile.
struct Turn {
  bool made = false;
  bool from_start = false;                           // made from the start mesh
  bool rolled_back = false;                          // taken from job.rollback_to
  const std::vector<RedoReason>* reasons = nullptr;  // of an update; null: images do not tell
};

Turn TurnOf(const LineageJob& job, int tile) {
  Turn turn;
  turn.made = job.made.contains(tile);
  turn.from_start = turn.made && (job.base.empty() || job.from_scratch);
  turn.rolled_back = job.rolled_back.contains(tile);
  if (const auto it = job.redos.find(tile); turn.made && it != job.redos.end()) turn.reasons = &it->second;
  return turn;
}

std::string ReasonsWords(const std::vector<RedoReason>& reasons) {
  std::vector<std::string> words;
  for (const RedoReason& reason : reasons) {
    words.push_back(reason.images.empty()
                        ? reason.reason
                        : absl::StrFormat("%s: %d (%s%s)", reason.reason, reason.images.size(), reason.images.front(),
                                          reason.images.size() > 1 ? ", ..." : ""));
  }
  return absl::StrJoin(words, "; ");
}

std::string TurnWords(const LineageJob& job, int tile) {
  const Turn turn = TurnOf(job, tile);
  if (turn.rolled_back) return "rolled back to " + job.rollback_to;
  if (!turn.made) return "kept from " + job.base;
  std::string words = job.base.empty()  ? "made from the start mesh"
                      : turn.from_start ? "redone from the start mesh"
                                        : "redone from " + job.base;
  if (turn.reasons != nullptr) words += " because: " + ReasonsWords(*turn.reasons);
  return words;
}

Json TileJson(const Lineage& lineage, const TileLineage& tile) {
  const CellRect& core = tile.tile.core;
  Json history = Json::array();
  for (const LineageJob& job : lineage.chain) {
    const Turn turn = TurnOf(job, tile.tile.tile);
    const char* const did = turn.rolled_back   ? "rolled back"
                            : !turn.made       ? "kept"
                            : job.base.empty() ? "made"
                                               : "redone";
    Json entry = {{"job", job.name}, {"did", did}};
    if (turn.rolled_back) entry["to"] = job.rollback_to;
    if (turn.made) entry["from_start"] = turn.from_start;
    if (turn.reasons != nullptr) {
      entry["why"] = Json::array();
      for (const RedoReason& why : *turn.reasons)
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
                                                 " tiles of ", lineage.chain.front().name, ", from 0 on"));
}

}  // namespace

std::string LineageTable(const Lineage& lineage) {
  using Row = std::vector<std::string>;
  std::vector<Row> rows = {{"TILE", "CORE", "MADE BY", "FINISHED", "VERSION", "METHOD", "IMAGES", "STATE"}};
  for (const TileLineage& tile : lineage.tiles) {
    const LineageJob& job = lineage.chain[tile.made_by];
    rows.push_back({absl::StrCat(tile.tile.tile), CoreWords(tile.tile.core), JobWords(job),
                    UtcTime(job.finished_s, "%Y-%m-%d"), OrDash(job.algorithm_version), OrDash(job.method),
                    ImagesWords(tile), tile.state.sha256});
  }
  std::vector<size_t> widths(rows.front().size());
  for (const Row& row : rows) {
    for (size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  std::string out;
  for (const Row& row : rows) {
    for (size_t i = 0; i + 1 < row.size(); ++i) out += row[i] + std::string(widths[i] - row[i].size() + 2, ' ');
    out += row.back() + "\n";
  }
  return out;
}

StatusOr<std::string> TileLineageText(const Lineage& lineage, int id, bool with_images) {
  TESSERA_ASSIGN_OR_RETURN(const TileLineage* const tile, FindTile(lineage, id));
  const LineageJob& maker = lineage.chain[tile->made_by];
  std::string out = absl::StrFormat(
      "tile %d of %s, cells %s\nmade by %s, finished %s, method %s, version %s of the algorithms\nstate %s\nimages: "
      "%s\n",
      id, JobWords(lineage.chain.front()), CoreWords(tile->tile.core), JobWords(maker),
      UtcTime(maker.finished_s, "%Y-%m-%d %H:%M:%S UTC"), OrDash(maker.method), OrDash(maker.algorithm_version),
      tile->state.sha256, ImagesWords(*tile));
  const char* arrow = "   ";
  for (const LineageJob& job : lineage.chain) {
    absl::StrAppend(&out, arrow, JobWords(job), ": ", TurnWords(job, id), "\n");
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
