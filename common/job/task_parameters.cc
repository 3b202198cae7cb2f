#include "common/job/task_parameters.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "common/base/json_bounds.h"
#include "common/job/exact_numbers.h"

namespace tessera {
namespace {

using json = nlohmann::basic_json<std::map, std::vector, std::string, bool, int64_t, uint64_t, double, std::allocator,
                                  ExactNumbers<nlohmann::adl_serializer>::Serializer>;

json RectToJson(const CellRect& rect) { return {rect.x0, rect.y0, rect.x1, rect.y1}; }
CellRect RectFromJson(const json& j) { return {j.at(0), j.at(1), j.at(2), j.at(3)}; }

json TileToJson(const TileParameters& t) { return {{"tile", t.tile}, {"core", RectToJson(t.core)}}; }
TileParameters TileFromJson(const json& j) { return {j.at("tile"), RectFromJson(j.at("core"))}; }

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
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth("task parameters", text));
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

std::string ViewFileName(int32_t view, bool likelihoods) {
  std::string number = std::to_string(view);
  if (number.size() < 6) number.insert(0, 6 - number.size(), '0');
  return "views/" + number + (likelihoods ? kLikelihoodsEnding : ".image");
}

std::string ViewBordersName(int32_t view) {
  const std::string image = ViewFileName(view, false);
  return image.substr(0, image.rfind('.')) + ".borders";
}

namespace {

json IngestToJson(const IngestParameters& p) {
  json out = json::object();
  if (p.partners) out["partners"] = *p.partners;
  if (p.views_per_direction) out["views_per_direction"] = *p.views_per_direction;
  if (p.classify) out["classify"] = p.by_default_rule ? "default" : "model";
  return out;
}

IngestParameters IngestFromJson(const json& j) {
  IngestParameters parameters;
  if (j.contains("partners")) parameters.partners = j.at("partners").get<int>();
  if (j.contains("views_per_direction")) parameters.views_per_direction = j.at("views_per_direction").get<int>();
  parameters.classify = j.contains("classify");
  parameters.by_default_rule = parameters.classify && j.at("classify").get<std::string>() == "default";
  return parameters;
}

}  // namespace

std::string ToJson(const IngestParameters& p) { return IngestToJson(p).dump(); }

std::string ToJson(const UpdateParameters& p) {
  return json{{"ingest", IngestToJson(p.ingest)}, {"withdraw", p.withdraw}, {"all_epochs", p.all_epochs}}.dump();
}

std::string ToJson(const UpdateFiles& files) {
  json known = json::object();
  for (const auto& [path, of] : files.known) {
    known[path] = {{"mesh", of.mesh}, {"content", of.content}};
    if (!of.classified.empty()) known[path]["classified"] = of.classified;
  }
  return json{{"known", std::move(known)}, {"carried", files.carried}}.dump();
}

std::string ToJson(const CutParameters& p) {
  json out = {{"tile", TileToJson(p.tile)},
              {"cores", json::array()},
              {"window_px", p.window_px},
              {"coarsest_level", p.coarsest_level}};
  for (const CellRect& core : p.cores) out["cores"].push_back(RectToJson(core));
  if (p.borders) out["borders"] = true;
  return out.dump();
}

std::string ToJson(const ClassifyParameters& p) {
  return json{{"view", p.view},   {"camera", p.view_json}, {"classes", p.classes_json},   {"up", p.up},
              {"gsd_m", p.gsd_m}, {"depth_m", p.depth_m},  {"default", p.by_default_rule}}
      .dump();
}

std::string ToJson(const BordersParameters& p) { return json{{"classes", p.classes}, {"views", p.views}}.dump(); }

std::string ToJson(const StartParameters& p) { return json{{"tile", TileToJson(p.tile)}}.dump(); }

std::string ToJson(const RefineParameters& p) {
  return json{{"rounds", p.rounds}, {"method", p.method}, {"settings", json::parse(ToJson(p.settings))}}.dump();
}

std::string ToJson(const StepParameters& p) {
  json out = {{"rounds", p.rounds}, {"method", p.method},         {"settings", json::parse(ToJson(p.settings))},
              {"step", p.step},     {"tile", TileToJson(p.tile)}, {"states", p.states},
              {"sums", p.sums}};
  if (p.before) out["before"] = true;
  if (!p.frozen.empty()) out["held"] = p.frozen;
  if (p.continues_base) out["goes_on"] = true;
  if (p.first_new_face >= 0) out["first_new_face"] = p.first_new_face;
  return out.dump();
}

std::string ToJson(const TileReads& r) {
  return json{{"label", r.label}, {"mend", r.repair}, {"sight", r.visibility}, {"solve", r.solve}}.dump();
}

std::string ChangeBlockFile(const CellRect& cells) {
  return "changes/" + std::to_string(cells.x0) + "_" + std::to_string(cells.y0) + ".arrays";
}

std::string ToJson(const CompareParameters& p) {
  return json{{"cells", RectToJson(p.cells)}, {"views", p.views}, {"states", p.states}}.dump();
}

std::string ToJson(const ChangesParameters& p) {
  json blocks = json::array();
  for (const CellRect& block : p.blocks) blocks.push_back(RectToJson(block));
  json out = {{"blocks", std::move(blocks)}, {"states", p.states}, {"scene_name", p.scene_name}};
  if (p.outdated) out["outdated"] = true;
  return out.dump();
}

std::string ToJson(const PublishParameters& p) {
  json out = {{"tiles", TilesToJson(p.tiles)}, {"scene_name", p.scene_name}, {"warnings", p.warnings}};
  if (!p.kept.empty()) out["kept"] = p.kept;
  if (p.outdated) out["outdated"] = true;
  if (!p.quarantined.empty()) out["set_aside"] = p.quarantined;
  if (p.flip_edges) out["flip_edges"] = true;
  return out.dump();
}

StatusOr<IngestParameters> ParseIngestParameters(const std::string& text) {
  return Parse<IngestParameters>(text, IngestFromJson);
}

StatusOr<UpdateParameters> ParseUpdateParameters(const std::string& text) {
  return Parse<UpdateParameters>(text, [](const json& j) {
    return UpdateParameters{IngestFromJson(j.at("ingest")), j.at("withdraw").get<std::vector<std::string>>(),
                            j.at("all_epochs")};
  });
}

StatusOr<UpdateFiles> ParseUpdateFiles(const std::string& text) {
  return Parse<UpdateFiles>(text, [](const json& j) {
    UpdateFiles files;
    for (const auto& [path, of] : j.at("known").items()) {
      files.known[path] = {of.at("mesh"), of.at("content"), of.value("classified", std::string())};
    }
    j.at("carried").get_to(files.carried);
    return files;
  });
}

StatusOr<CutParameters> ParseCutParameters(const std::string& text) {
  return Parse<CutParameters>(text, [](const json& j) {
    CutParameters p = {TileFromJson(j.at("tile")), {}, j.at("window_px"), j.at("coarsest_level")};
    for (const json& core : j.at("cores")) p.cores.push_back(RectFromJson(core));
    p.borders = j.contains("borders") && j.at("borders").get<bool>();
    return p;
  });
}

StatusOr<ClassifyParameters> ParseClassifyParameters(const std::string& text) {
  return Parse<ClassifyParameters>(text, [](const json& j) {
    ClassifyParameters p;
    p.view = j.at("view");
    p.view_json = j.at("camera").get<std::string>();
    p.classes_json = j.at("classes").get<std::string>();
    p.up = j.at("up").get<std::vector<double>>();
    p.gsd_m = j.at("gsd_m");
    p.depth_m = j.at("depth_m");
    p.by_default_rule = j.at("default");
    return p;
  });
}

StatusOr<BordersParameters> ParseBordersParameters(const std::string& text) {
  return Parse<BordersParameters>(text, [](const json& j) {
    return BordersParameters{j.at("classes"), j.at("views").get<std::vector<int32_t>>()};
  });
}

StatusOr<StartParameters> ParseStartParameters(const std::string& text) {
  return Parse<StartParameters>(text, [](const json& j) { return StartParameters{TileFromJson(j.at("tile"))}; });
}

StatusOr<RefineParameters> ParseRefineParameters(const std::string& text) {
  std::string settings;
  TESSERA_ASSIGN_OR_RETURN(RefineParameters parameters, Parse<RefineParameters>(text, [&settings](const json& j) {
                             settings = j.at("settings").dump();
                             return RefineParameters{j.at("rounds"), j.at("method").get<std::string>()};
                           }));
  TESSERA_ASSIGN_OR_RETURN(parameters.settings, ParseMethodSettings(settings));
  return parameters;
}

StatusOr<StepParameters> ParseStepParameters(const std::string& text) {
  std::string settings;
  TESSERA_ASSIGN_OR_RETURN(StepParameters parameters, Parse<StepParameters>(text, [&settings](const json& j) {
                             settings = j.at("settings").dump();
                             StepParameters p;
                             p.rounds = j.at("rounds");
                             p.method = j.at("method").get<std::string>();
                             p.step = j.at("step");
                             p.before = j.value("before", false);
                             p.tile = TileFromJson(j.at("tile"));
                             p.states = j.at("states").get<std::vector<int>>();
                             p.sums = j.at("sums").get<std::vector<int>>();
                             p.frozen = j.value("held", std::vector<int>());
                             p.continues_base = j.value("goes_on", false);
                             p.first_new_face = j.value("first_new_face", int64_t{-1});
                             return p;
                           }));
  TESSERA_ASSIGN_OR_RETURN(parameters.settings, ParseMethodSettings(settings));
  return parameters;
}

StatusOr<TileReads> ParseTileReads(const std::string& text, int tile, int tiles) {
  const auto fault = [](const std::string& found) {
    return absl::InvalidArgumentError(std::string(kReadsFile) + ": " + found);
  };
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth(kReadsFile, text));
  TileReads reads;
  try {
    const json j = json::parse(text);
    j.at("label").get_to(reads.label);
    j.at("mend").get_to(reads.repair);
    j.at("sight").get_to(reads.visibility);
    j.at("solve").get_to(reads.solve);
  } catch (const json::exception& e) {
    return fault(e.what());
  }
  // Rejects unknown keys, numbers that are not integers, and other formatting.
  if (ToJson(reads) != text) return fault("found another form than the canonical JSON of this version");
  const auto check = [&](const char* name, const std::vector<int>& ids) -> Status {
    for (size_t i = 0; i < ids.size(); ++i) {
      if (ids[i] < 0 || ids[i] >= tiles) {
        return fault(std::string(name) + ": found tile " + std::to_string(ids[i]) + ", expected 0 to " +
                     std::to_string(tiles - 1));
      }
      if (i > 0 && ids[i] <= ids[i - 1]) {
        return fault(std::string(name) + ": found tile " + std::to_string(ids[i]) + " after " +
                     std::to_string(ids[i - 1]) + ", expected ascending ids");
      }
    }
    if (!std::binary_search(ids.begin(), ids.end(), tile)) {
      return fault(std::string(name) + ": expected the tile itself, " + std::to_string(tile) + ", among the ids");
    }
    return absl::OkStatus();
  };
  TESSERA_RETURN_IF_ERROR(check("label", reads.label));
  TESSERA_RETURN_IF_ERROR(check("mend", reads.repair));
  TESSERA_RETURN_IF_ERROR(check("sight", reads.visibility));
  TESSERA_RETURN_IF_ERROR(check("solve", reads.solve));
  return reads;
}

StatusOr<CompareParameters> ParseCompareParameters(const std::string& text) {
  return Parse<CompareParameters>(text, [](const json& j) {
    return CompareParameters{RectFromJson(j.at("cells")), j.at("views").get<std::vector<int32_t>>(),
                             j.at("states").get<std::vector<int>>()};
  });
}

StatusOr<ChangesParameters> ParseChangesParameters(const std::string& text) {
  return Parse<ChangesParameters>(text, [](const json& j) {
    ChangesParameters p;
    for (const json& block : j.at("blocks")) p.blocks.push_back(RectFromJson(block));
    j.at("states").get_to(p.states);
    j.at("scene_name").get_to(p.scene_name);
    p.outdated = j.value("outdated", false);
    return p;
  });
}

StatusOr<PublishParameters> ParsePublishParameters(const std::string& text) {
  return Parse<PublishParameters>(text, [](const json& j) {
    return PublishParameters{TilesFromJson(j.at("tiles")), j.value("kept", std::vector<int>()),
                             j.at("scene_name"),           j.at("warnings").get<std::vector<std::string>>(),
                             j.value("outdated", false),   j.value("set_aside", std::vector<int>()),
                             j.value("flip_edges", false)};
  });
}

}  // namespace tessera
