#include "server/display/plan_text.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/client/job_text.h"
#include "server/display/svg_map.h"
#include "server/tiling/ground_map.h"

namespace tessera {
namespace {

constexpr double kMiB = 1 << 20, kGiB = 1 << 30, kSquareKilometre = 1e6, kHour = 3600;

std::string RoundedThousands(double value) { return FormatThousands(std::llround(value)); }

std::string Row(const std::array<std::string, 9>& words) {
  std::string row;
  for (const std::string& word : words) absl::StrAppendFormat(&row, "%12s", word);
  return row + "\n";
}

// Faces that tiles load beyond their core, relative to the core faces.
double ExtraFacesShare(const Quote& quote) {
  return quote.core_faces > 0 ? quote.visible_faces / quote.core_faces - 1 : 0;
}

}  // namespace

std::string PlanTable(const Quote& quote, const PlanTerms& terms) {
  std::string out =
      Row({"tile", "cells", "faces", "visible", "cameras", "megapixels", "pair MP", "peak MiB", "core-s"});
  for (const TileQuote& tile : quote.tiles) {
    const CellRect& c = tile.core;
    out += Row({std::to_string(tile.tile), absl::StrCat(c.x1 - c.x0, " x ", c.y1 - c.y0),
                RoundedThousands(tile.work.core_faces), RoundedThousands(tile.work.visible_faces),
                std::to_string(tile.work.seeing_views), RoundedThousands(1e-6 * tile.work.pixels),
                RoundedThousands(1e-6 * tile.work.pair_pixels),
                RoundedThousands(static_cast<double>(tile.Total().peak_bytes) / kMiB),
                RoundedThousands(tile.Total().core_seconds)});
  }
  double most = 0;
  for (const TileQuote& tile : quote.tiles) most = std::max(most, tile.Total().core_seconds);
  const double mean = (quote.core_seconds - quote.ingest.core_seconds - quote.classify.core_seconds -
                       quote.split.core_seconds - quote.publish.core_seconds - quote.exports.core_seconds) /
                      static_cast<double>(std::max<size_t>(1, quote.tiles.size()));
  const double km2 = quote.area_m2 / kSquareKilometre,
               wall_s = WallSeconds(quote, terms.workers, terms.threads_per_worker);
  const Interval& i = quote.interval;
  const auto range = [&](double value, const char* format) {
    return absl::StrCat(absl::StrFormat(*absl::ParsedFormat<'f'>::New(format), value), " (",
                        absl::StrFormat(*absl::ParsedFormat<'f'>::New(format), i.low * value), " to ",
                        absl::StrFormat(*absl::ParsedFormat<'f'>::New(format), i.high * value), ")");
  };
  absl::StrAppendFormat(&out, "tiles: %d, %.0f %% more faces in the visible sets, heaviest / mean tile %.2f\n",
                        static_cast<int>(quote.tiles.size()), 100 * ExtraFacesShare(quote),
                        mean > 0 ? most / mean : 1.0);
  absl::StrAppendFormat(&out, "ingest: %.0f core-s, %.0f MiB; publish: %.0f core-s, %.0f MiB\n",
                        quote.ingest.core_seconds, static_cast<double>(quote.ingest.peak_bytes) / kMiB,
                        quote.publish.core_seconds, static_cast<double>(quote.publish.peak_bytes) / kMiB);
  if (quote.split.core_seconds > 0) {
    absl::StrAppendFormat(&out, "second split of faces: %.0f core-s, %.0f MiB\n", quote.split.core_seconds,
                          static_cast<double>(quote.split.peak_bytes) / kMiB);
  }
  if (quote.classify.core_seconds > 0) {
    absl::StrAppendFormat(&out, "classify: %.0f core-s, %.0f MiB\n", quote.classify.core_seconds,
                          static_cast<double>(quote.classify.peak_bytes) / kMiB);
  }
  if (quote.exports.core_seconds > 0) {
    absl::StrAppendFormat(&out, "exports: %.0f core-s, %.0f MiB\n", quote.exports.core_seconds,
                          static_cast<double>(quote.exports.peak_bytes) / kMiB);
  }
  absl::StrAppendFormat(&out, "memory of a worker: %.0f MiB at most\n", static_cast<double>(quote.peak_bytes) / kMiB);
  const double stored_gib = static_cast<double>(quote.stored_bytes) / kGiB;
  absl::StrAppendFormat(&out, "disk: %.2f GiB (%.2f to %.2f)\n", stored_gib, kStoredBytesInterval.low * stored_gib,
                        kStoredBytesInterval.high * stored_gib);
  absl::StrAppend(&out, "core-hours: ", range(quote.core_seconds / kHour, "%.3f"), "\n");
  absl::StrAppendFormat(&out, "area: %.4f km2", km2);
  if (km2 > 0) absl::StrAppend(&out, ", core-hours a km2: ", range(quote.core_seconds / kHour / km2, "%.2f"));
  absl::StrAppendFormat(&out, "\ntime with %d worker%s of %d core%s: %s (%s to %s)", terms.workers,
                        terms.workers == 1 ? "" : "s", terms.threads_per_worker,
                        terms.threads_per_worker == 1 ? "" : "s", FormatDuration(wall_s),
                        FormatDuration(i.low * wall_s), FormatDuration(i.high * wall_s));
  if (km2 > 0) absl::StrAppend(&out, ", hours a km2: ", range(wall_s / kHour / km2, "%.2f"));
  out += "\n";
  if (terms.price_per_core_hour) {
    absl::StrAppend(&out, "price: ", range(*terms.price_per_core_hour * quote.core_seconds / kHour, "%.2f"), "\n");
  }
  return out;
}

std::string PlanJson(const Quote& quote, const PlanTerms& terms) {
  using Json = nlohmann::ordered_json;
  const auto cost = [](const Prediction& p) {
    return Json{{"core_seconds", p.core_seconds}, {"peak_bytes", p.peak_bytes}, {"stored_bytes", p.stored_bytes}};
  };
  Json tiles = Json::array();
  for (const TileQuote& tile : quote.tiles) {
    Json json = {{"tile", tile.tile},
                 {"core", {tile.core.x0, tile.core.y0, tile.core.x1, tile.core.y1}},
                 {"core_faces", tile.work.core_faces},
                 {"visible_faces", std::round(tile.work.visible_faces)},
                 {"cameras", tile.work.seeing_views},
                 {"pixels", tile.work.pixels},
                 {"pair_pixels", tile.work.pair_pixels},
                 {"cut", cost(tile.cut)},
                 {"crop", cost(tile.crop)}};
    if (quote.tiles.size() == 1) {
      json["refine"] = cost(tile.refine);
    } else {
      json["measure"] = cost(tile.measure);
      json["solve"] = cost(tile.solve);
      json["mend"] = cost(tile.mend);
    }
    tiles.push_back(std::move(json));
  }
  const Interval& i = quote.interval;
  const double wall_s = WallSeconds(quote, terms.workers, terms.threads_per_worker);
  const auto range = [&](double value) {
    return Json{{"predicted", value}, {"low", i.low * value}, {"high", i.high * value}};
  };
  Json json = {{"tessera_plan", 1},
               {"area_m2", quote.area_m2},
               {"peak_bytes", quote.peak_bytes},
               {"stored_bytes", quote.stored_bytes},
               {"core_seconds", range(quote.core_seconds)},
               {"workers", terms.workers},
               {"threads_per_worker", terms.threads_per_worker},
               {"wall_seconds", range(wall_s)}};
  if (terms.price_per_core_hour) json["price"] = range(*terms.price_per_core_hour * quote.core_seconds / kHour);
  json["ingest"] = cost(quote.ingest);
  if (quote.classify.core_seconds > 0) json["classify"] = cost(quote.classify);
  if (quote.split.core_seconds > 0) json["split"] = cost(quote.split);
  json["publish"] = cost(quote.publish);
  if (quote.exports.core_seconds > 0) json["exports"] = cost(quote.exports);
  json["tiles"] = std::move(tiles);
  return json.dump(1) + "\n";
}

std::string PlanMap(const Quote& quote, const Survey& survey) {
  double least = 1e300, most = 0;
  for (const TileQuote& tile : quote.tiles) {
    least = std::min(least, tile.Total().core_seconds);
    most = std::max(most, tile.Total().core_seconds);
  }
  SvgMap map;
  for (const TileQuote& tile : quote.tiles) {
    // From pale to dark red.
    const double t = most > least ? (tile.Total().core_seconds - least) / (most - least) : 0;
    const GroundRect core = RectOnGround(tile.core, survey.ground);
    map.tiles.push_back(
        {core.x0_m, core.y0_m, core.x1_m, core.y1_m,
         absl::StrFormat("rgb(%d,%d,%d)", static_cast<int>(255 - 102 * t), static_cast<int>(240 - 220 * t),
                         static_cast<int>(217 - 200 * t)),
         absl::StrFormat("tile %d: %s faces, %d cameras, %.0f MiB, %.0f core-seconds", tile.tile,
                         RoundedThousands(tile.work.core_faces), tile.work.seeing_views,
                         static_cast<double>(tile.Total().peak_bytes) / kMiB, tile.Total().core_seconds)});
  }
  for (const MapView& view : MakeGroundMap(survey, {}).views) {
    map.cameras.push_back({view.on_ground.x(), view.on_ground.y(), "fill=\"#06c\""});
  }
  map.caption =
      absl::StrFormat("%d tiles of %.0f (pale) to %.0f (dark) core-seconds; dots: %d cameras",
                      static_cast<int>(quote.tiles.size()), least, most, static_cast<int>(map.cameras.size()));
  return ToSvg(map);
}

}  // namespace tessera
