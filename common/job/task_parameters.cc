#include "common/job/task_parameters.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "common/base/json_bounds.h"
#include "common/job/exact_numbers.h"
#include "common/scene/image_files.h"

namespace tessera {
namespace {

using json = nlohmann::basic_json<std::map, std::vector, std::string, bool, int64_t, uint64_t, double, std::allocator,
                                  ExactNumbers<nlohmann::adl_serializer>::Serializer>;

template <class Value, class Convert>
StatusOr<Value> Parse(const std::string& text, const Convert& convert) {
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth("task parameters", text));
  try {
    return convert(json::parse(text));
  } catch (const json::exception& e) {
    return absl::InvalidArgumentError(std::string("task parameters: ") + e.what());
  }
}

template <class Value>
StatusOr<Value> Parse(const std::string& text) {
  return Parse<Value>(text, [](const json& j) { return j.get<Value>(); });
}

// Also parses the method settings, of which json does not know the type.
template <class Value>
StatusOr<Value> ParseWithSettings(const std::string& text) {
  std::string settings;
  TESSERA_ASSIGN_OR_RETURN(Value parameters, Parse<Value>(text, [&settings](const json& j) {
                             settings = j.at("settings").dump();
                             return j.get<Value>();
                           }));
  TESSERA_ASSIGN_OR_RETURN(parameters.settings, ParseMethodSettings(settings));
  return parameters;
}

constexpr char kViewFolder[] = "views/";

}  // namespace

std::string TileInputName(int tile, const std::string& file) {
  std::string number = std::to_string(tile);
  if (number.size() < 4) number.insert(0, 4 - number.size(), '0');
  return number + "/" + file;
}

std::string ViewFileName(int32_t view, bool likelihoods) {
  std::string number = std::to_string(view);
  if (number.size() < 6) number.insert(0, 6 - number.size(), '0');
  return kViewFolder + number + (likelihoods ? kLikelihoodsEnding : ".image");
}

std::string ViewMaskName(int32_t view) {
  const std::string image = ViewFileName(view, false);
  return image.substr(0, image.rfind('.')) + ".mask";
}

std::string ViewBordersName(int32_t view) {
  const std::string image = ViewFileName(view, false);
  return image.substr(0, image.rfind('.')) + ".borders";
}

void FetchedOnDemand::AddInput(const std::string& name) {
  reads_inspections_ = reads_inspections_ || name.ends_with(absl::StrCat("/", kInspectionFile));
  reads_crops_ = reads_crops_ || name.ends_with(absl::StrCat("/", kViewsFile));
}

bool FetchedOnDemand::operator()(const std::string& name) const {
  if (name.starts_with(kViewFolder)) return reads_crops_;
  return reads_inspections_ && name.starts_with(absl::StrCat(kSceneFolder, "/")) && IsPixelFile(name);
}

// The conversions that the JSON library finds by the type of their argument.

static void to_json(json& j, const CellRect& rect) { j = {rect.x0, rect.y0, rect.x1, rect.y1}; }
static void from_json(const json& j, CellRect& rect) { rect = {j.at(0), j.at(1), j.at(2), j.at(3)}; }

static void to_json(json& j, const TileParameters& t) { j = {{"tile", t.tile}, {"core", t.core}}; }
static void from_json(const json& j, TileParameters& t) { t = {j.at("tile"), j.at("core").get<CellRect>()}; }

static void to_json(json& j, const InspectParameters& p) {
  j = json::object();
  if (p.classify) j["classify"] = true;
}
static void from_json(const json& j, InspectParameters& p) { p.classify = j.value("classify", false); }

static void to_json(json& j, const IngestParameters& p) {
  j = json::object();
  if (p.partners) j["partners"] = *p.partners;
  if (p.views_per_direction) j["views_per_direction"] = *p.views_per_direction;
  if (p.classify) j["classify"] = p.by_default_rule ? "default" : "model";
  if (p.skip_images > 0) j["skip_images"] = p.skip_images;
  if (p.anyway) j["anyway"] = true;
  if (p.coarse_faces) j["coarse_faces"] = true;
  if (p.inspections > 0) j["inspections"] = p.inspections;
}
static void from_json(const json& j, IngestParameters& p) {
  if (j.contains("partners")) p.partners = j.at("partners").get<int>();
  if (j.contains("views_per_direction")) p.views_per_direction = j.at("views_per_direction").get<int>();
  p.classify = j.contains("classify");
  p.by_default_rule = p.classify && j.at("classify").get<std::string>() == "default";
  p.skip_images = j.value("skip_images", 0.0);
  p.anyway = j.value("anyway", false);
  p.coarse_faces = j.value("coarse_faces", false);
  if (j.contains("inspections")) p.inspections = j.at("inspections").get<int>();
}

static void to_json(json& j, const UpdateParameters& p) {
  j = {{"ingest", p.ingest}, {"withdraw", p.withdraw}, {"all_epochs", p.all_epochs}};
}
static void from_json(const json& j, UpdateParameters& p) {
  j.at("ingest").get_to(p.ingest);
  j.at("withdraw").get_to(p.withdraw);
  j.at("all_epochs").get_to(p.all_epochs);
}

static void to_json(json& j, const UpdateFiles::Known& known) {
  j = {{"mesh", known.mesh}, {"content", known.content}};
  if (!known.classified.empty()) j["classified"] = known.classified;
}
static void from_json(const json& j, UpdateFiles::Known& known) {
  known = {j.at("mesh"), j.at("content"), j.value("classified", std::string())};
}

static void to_json(json& j, const UpdateFiles& files) {
  j = {{"known", json::object()}, {"carried", files.carried}};
  for (const auto& [path, known] : files.known) j["known"][path] = known;
}
static void from_json(const json& j, UpdateFiles& files) {
  for (const auto& [path, known] : j.at("known").items()) known.get_to(files.known[path]);
  j.at("carried").get_to(files.carried);
}

static void to_json(json& j, const CutParameters& p) {
  j = {{"tile", p.tile}, {"cores", p.cores}, {"window_px", p.window_px}, {"coarsest_level", p.coarsest_level}};
  if (p.borders) j["borders"] = true;
  if (!p.fine_iterations.empty()) j["fine_iterations"] = p.fine_iterations;
  if (p.max_step_px) j["max_step_px"] = *p.max_step_px;
}
static void from_json(const json& j, CutParameters& p) {
  j.at("tile").get_to(p.tile);
  j.at("cores").get_to(p.cores);
  j.at("window_px").get_to(p.window_px);
  j.at("coarsest_level").get_to(p.coarsest_level);
  p.borders = j.contains("borders") && j.at("borders").get<bool>();
  p.fine_iterations = j.value("fine_iterations", std::vector<int>());
  if (j.contains("max_step_px")) p.max_step_px = j.at("max_step_px").get<double>();
}

static void to_json(json& j, const CropParameters& p) {
  j = {{"tiles", p.tiles}};
  if (!p.coarse.empty()) j["coarse"] = p.coarse;
}
static void from_json(const json& j, CropParameters& p) {
  j.at("tiles").get_to(p.tiles);
  p.coarse = j.value("coarse", std::vector<int>());
}

static void to_json(json& j, const ClassifyParameters& p) {
  j = {{"view", p.view},   {"camera", p.view_json}, {"classes", p.classes_json},   {"up", p.up},
       {"gsd_m", p.gsd_m}, {"depth_m", p.depth_m},  {"default", p.by_default_rule}};
}
static void from_json(const json& j, ClassifyParameters& p) {
  j.at("view").get_to(p.view);
  j.at("camera").get_to(p.view_json);
  j.at("classes").get_to(p.classes_json);
  j.at("up").get_to(p.up);
  j.at("gsd_m").get_to(p.gsd_m);
  j.at("depth_m").get_to(p.depth_m);
  j.at("default").get_to(p.by_default_rule);
}

static void to_json(json& j, const BordersParameters& p) { j = {{"classes", p.classes}, {"views", p.views}}; }
static void from_json(const json& j, BordersParameters& p) {
  j.at("classes").get_to(p.classes);
  j.at("views").get_to(p.views);
}

static void to_json(json& j, const StartParameters& p) {
  j = {{"tile", p.tile}};
  if (p.moved) j["moved"] = true;
}
static void from_json(const json& j, StartParameters& p) {
  j.at("tile").get_to(p.tile);
  p.moved = j.value("moved", false);
}

static void to_json(json& j, const SplitParameters& p) { j = {{"tiles", p.tiles}}; }
static void from_json(const json& j, SplitParameters& p) { j.at("tiles").get_to(p.tiles); }

static void to_json(json& j, const RefineParameters& p) {
  j = {{"rounds", p.rounds}, {"method", p.method}, {"settings", json::parse(ToJson(p.settings))}};
  if (p.part != JobPart::kWhole) j["part"] = p.part == JobPart::kCoarse ? "coarse" : "fine";
}
static void from_json(const json& j, RefineParameters& p) {
  j.at("rounds").get_to(p.rounds);
  j.at("method").get_to(p.method);
  if (j.contains("part")) p.part = j.at("part").get<std::string>() == "coarse" ? JobPart::kCoarse : JobPart::kFine;
}

static void to_json(json& j, const StepParameters& p) {
  j = {{"rounds", p.rounds}, {"method", p.method}, {"settings", json::parse(ToJson(p.settings))},
       {"step", p.step},     {"tile", p.tile},     {"states", p.states},
       {"sums", p.sums}};
  if (p.before) j["before"] = true;
  if (!p.frozen.empty()) j["held"] = p.frozen;
  if (p.continues_base) j["goes_on"] = true;
  if (p.first_new_face >= 0) j["first_new_face"] = p.first_new_face;
}
static void from_json(const json& j, StepParameters& p) {
  j.at("rounds").get_to(p.rounds);
  j.at("method").get_to(p.method);
  j.at("step").get_to(p.step);
  p.before = j.value("before", false);
  j.at("tile").get_to(p.tile);
  j.at("states").get_to(p.states);
  j.at("sums").get_to(p.sums);
  p.frozen = j.value("held", std::vector<int>());
  p.continues_base = j.value("goes_on", false);
  p.first_new_face = j.value("first_new_face", int64_t{-1});
}

static void to_json(json& j, const TileReads& r) {
  j = {{"label", r.label}, {"mend", r.repair}, {"sight", r.visibility}, {"solve", r.solve}};
}
static void from_json(const json& j, TileReads& r) {
  j.at("label").get_to(r.label);
  j.at("mend").get_to(r.repair);
  j.at("sight").get_to(r.visibility);
  j.at("solve").get_to(r.solve);
}

static void to_json(json& j, const CompareParameters& p) {
  j = {{"cells", p.cells}, {"views", p.views}, {"states", p.states}};
}
static void from_json(const json& j, CompareParameters& p) {
  j.at("cells").get_to(p.cells);
  j.at("views").get_to(p.views);
  j.at("states").get_to(p.states);
}

static void to_json(json& j, const ChangesParameters& p) {
  j = {{"blocks", p.blocks}, {"states", p.states}, {"scene_name", p.scene_name}};
  if (p.outdated) j["outdated"] = true;
}
static void from_json(const json& j, ChangesParameters& p) {
  j.at("blocks").get_to(p.blocks);
  j.at("states").get_to(p.states);
  j.at("scene_name").get_to(p.scene_name);
  p.outdated = j.value("outdated", false);
}

static void to_json(json& j, const PublishParameters& p) {
  j = {{"tiles", p.tiles}, {"scene_name", p.scene_name}, {"warnings", p.warnings}};
  if (!p.view_names.empty()) j["view_names"] = p.view_names;
  if (!p.kept.empty()) j["kept"] = p.kept;
  if (!p.fit.empty()) j["fit"] = p.fit;
  j["source"] = p.source;  // also empty: the reports of results stored before have no frame
  if (p.outdated) j["outdated"] = true;
  if (!p.quarantined.empty()) j["set_aside"] = p.quarantined;
  if (p.flip_edges) j["flip_edges"] = true;
  if (!p.skipped_images.empty()) j["skipped_images"] = p.skipped_images;
}
static void from_json(const json& j, PublishParameters& p) {
  j.at("tiles").get_to(p.tiles);
  p.kept = j.value("kept", std::vector<int>());
  j.at("scene_name").get_to(p.scene_name);
  j.at("warnings").get_to(p.warnings);
  p.view_names = j.value("view_names", std::vector<std::string>());
  p.fit = j.value("fit", std::string());
  p.source = j.value("source", std::string());
  p.outdated = j.value("outdated", false);
  p.quarantined = j.value("set_aside", std::vector<int>());
  p.flip_edges = j.value("flip_edges", false);
  p.skipped_images = j.value("skipped_images", std::vector<std::pair<std::string, std::string>>());
}

std::string ChangeBlockFile(const CellRect& cells) {
  return "changes/" + std::to_string(cells.x0) + "_" + std::to_string(cells.y0) + ".arrays";
}

std::string ToJson(const InspectParameters& parameters) { return json(parameters).dump(); }
std::string ToJson(const IngestParameters& parameters) { return json(parameters).dump(); }
std::string ToJson(const UpdateParameters& parameters) { return json(parameters).dump(); }
std::string ToJson(const UpdateFiles& parameters) { return json(parameters).dump(); }
std::string ToJson(const CutParameters& parameters) { return json(parameters).dump(); }
std::string ToJson(const CropParameters& parameters) { return json(parameters).dump(); }
std::string ToJson(const ClassifyParameters& parameters) { return json(parameters).dump(); }
std::string ToJson(const BordersParameters& parameters) { return json(parameters).dump(); }
std::string ToJson(const StartParameters& parameters) { return json(parameters).dump(); }
std::string ToJson(const SplitParameters& parameters) { return json(parameters).dump(); }
std::string ToJson(const RefineParameters& parameters) { return json(parameters).dump(); }
std::string ToJson(const StepParameters& parameters) { return json(parameters).dump(); }
std::string ToJson(const TileReads& parameters) { return json(parameters).dump(); }
std::string ToJson(const CompareParameters& parameters) { return json(parameters).dump(); }
std::string ToJson(const ChangesParameters& parameters) { return json(parameters).dump(); }
std::string ToJson(const PublishParameters& parameters) { return json(parameters).dump(); }

StatusOr<InspectParameters> ParseInspectParameters(const std::string& text) { return Parse<InspectParameters>(text); }
StatusOr<IngestParameters> ParseIngestParameters(const std::string& text) { return Parse<IngestParameters>(text); }
StatusOr<UpdateParameters> ParseUpdateParameters(const std::string& text) { return Parse<UpdateParameters>(text); }
StatusOr<UpdateFiles> ParseUpdateFiles(const std::string& text) { return Parse<UpdateFiles>(text); }
StatusOr<CutParameters> ParseCutParameters(const std::string& text) { return Parse<CutParameters>(text); }
StatusOr<CropParameters> ParseCropParameters(const std::string& text) { return Parse<CropParameters>(text); }
StatusOr<ClassifyParameters> ParseClassifyParameters(const std::string& text) {
  return Parse<ClassifyParameters>(text);
}
StatusOr<BordersParameters> ParseBordersParameters(const std::string& text) { return Parse<BordersParameters>(text); }
StatusOr<StartParameters> ParseStartParameters(const std::string& text) { return Parse<StartParameters>(text); }
StatusOr<SplitParameters> ParseSplitParameters(const std::string& text) { return Parse<SplitParameters>(text); }
StatusOr<RefineParameters> ParseRefineParameters(const std::string& text) {
  return ParseWithSettings<RefineParameters>(text);
}
StatusOr<StepParameters> ParseStepParameters(const std::string& text) {
  return ParseWithSettings<StepParameters>(text);
}
StatusOr<CompareParameters> ParseCompareParameters(const std::string& text) { return Parse<CompareParameters>(text); }
StatusOr<ChangesParameters> ParseChangesParameters(const std::string& text) { return Parse<ChangesParameters>(text); }
StatusOr<PublishParameters> ParsePublishParameters(const std::string& text) { return Parse<PublishParameters>(text); }

StatusOr<TileReads> ParseTileReads(const std::string& text, int tile, int tiles) {
  const auto fault = [](const std::string& found) {
    return absl::InvalidArgumentError(std::string(kReadsFile) + ": " + found);
  };
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth(kReadsFile, text));
  TileReads reads;
  try {
    json::parse(text).get_to(reads);
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

}  // namespace tessera
