#include "common/tile/task_parameters.h"

#include <nlohmann/json.hpp>

namespace tessera {
namespace {

using nlohmann::json;

json TileToJson(const TileParameters& t) {
  return {{"tile", t.tile}, {"core", {t.core.x0, t.core.y0, t.core.x1, t.core.y1}}};
}

TileParameters TileFromJson(const json& j) {
  const json& core = j.at("core");
  return {j.at("tile"), {core.at(0), core.at(1), core.at(2), core.at(3)}};
}

json TilesToJson(const std::vector<TileParameters>& tiles) {
  json out = json::array();
  for (const TileParameters& tile : tiles) out.push_back(TileToJson(tile));
  return out;
}

std::vector<TileParameters> TilesFromJson(const json& j) {
  std::vector<TileParameters> tiles;
  for (const json& tile : j) tiles.push_back(TileFromJson(tile));
  return tiles;
}

template <class Value, class Convert>
StatusOr<Value> Parse(const std::string& text, const Convert& convert) {
  try {
    return convert(json::parse(text));
  } catch (const json::exception& e) {
    return absl::InvalidArgumentError(std::string("task parameters: ") + e.what());
  }
}

}  // namespace

std::string TileInputName(int tile, const std::string& file) {
  std::string number = std::to_string(tile);
  if (number.size() < 4) number.insert(0, 4 - number.size(), '0');
  return number + "/" + file;
}

std::string ToJson(const IngestParameters& p) {
  json out = json::object();
  if (p.partners) out["partners"] = *p.partners;
  if (p.views_per_direction) out["views_per_direction"] = *p.views_per_direction;
  return out.dump();
}

std::string ToJson(const CutParameters& p) {
  return json{{"tile", TileToJson(p.tile)}, {"halo_m", p.halo_m}, {"views", p.views}}.dump();
}

std::string ToJson(const RefineParameters& p) {
  return json{{"rounds", p.rounds},
              {"method", p.method},
              {"settings", json::parse(ToJson(p.settings))},
              {"begin", p.begin},
              {"end", p.end},
              {"tile", TileToJson(p.tile)},
              {"blend_m", p.blend_m},
              {"results", TilesToJson(p.results)}}
      .dump();
}

std::string ToJson(const StitchParameters& p) {
  return json{{"tile", TileToJson(p.tile)}, {"blend_m", p.blend_m}, {"results", TilesToJson(p.results)}}.dump();
}

std::string ToJson(const PublishParameters& p) { return json{{"tiles", TilesToJson(p.tiles)}}.dump(); }

StatusOr<IngestParameters> ParseIngestParameters(const std::string& text) {
  return Parse<IngestParameters>(text, [](const json& j) {
    IngestParameters parameters;
    if (j.contains("partners")) parameters.partners = j.at("partners").get<int>();
    if (j.contains("views_per_direction")) parameters.views_per_direction = j.at("views_per_direction").get<int>();
    return parameters;
  });
}

StatusOr<CutParameters> ParseCutParameters(const std::string& text) {
  return Parse<CutParameters>(text, [](const json& j) {
    return CutParameters{TileFromJson(j.at("tile")), j.at("halo_m"), j.at("views").get<std::vector<int32_t>>()};
  });
}

StatusOr<RefineParameters> ParseRefineParameters(const std::string& text) {
  std::string settings;
  TESSERA_ASSIGN_OR_RETURN(RefineParameters parameters, Parse<RefineParameters>(text, [&settings](const json& j) {
                             settings = j.at("settings").dump();
                             return RefineParameters{j.at("rounds"),
                                                     j.at("method").get<std::string>(),
                                                     {},
                                                     j.at("begin"),
                                                     j.at("end"),
                                                     TileFromJson(j.at("tile")),
                                                     j.at("blend_m"),
                                                     TilesFromJson(j.at("results"))};
                           }));
  TESSERA_ASSIGN_OR_RETURN(parameters.settings, ParseMethodSettings(settings));
  return parameters;
}

StatusOr<StitchParameters> ParseStitchParameters(const std::string& text) {
  return Parse<StitchParameters>(text, [](const json& j) {
    return StitchParameters{TileFromJson(j.at("tile")), j.at("blend_m"), TilesFromJson(j.at("results"))};
  });
}

StatusOr<PublishParameters> ParsePublishParameters(const std::string& text) {
  return Parse<PublishParameters>(text, [](const json& j) { return PublishParameters{TilesFromJson(j.at("tiles"))}; });
}

}  // namespace tessera
