#include "common/job/survey.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <map>
#include <limits>
#include <nlohmann/json.hpp>

#include "common/base/json_bounds.h"
#include "common/job/exact_numbers.h"
#include "common/job/task_parameters.h"
#include "common/storage/hash.h"

namespace tessera {
namespace {

using json = nlohmann::basic_json<std::map, std::vector, std::string, bool, int64_t, uint64_t, double, std::allocator,
                                  ExactNumbers<nlohmann::adl_serializer>::Serializer>;

json VectorToJson(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

Eigen::Vector3d VectorFromJson(const json& j) {
  return Eigen::Vector3d(j.at(0).get<double>(), j.at(1).get<double>(), j.at(2).get<double>());
}

json MatrixToJson(const Eigen::Matrix3d& m) {
  json out = json::array();
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) out.push_back(m(r, c));
  }
  return out;
}

Eigen::Matrix3d MatrixFromJson(const json& j) {
  Eigen::Matrix3d m;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) m(r, c) = j.at(3 * r + c).get<double>();
  }
  return m;
}

// One entry per pair of classes with a positive weight: [first, second, bias, sigma, weight].
json BorderArray(const BorderTrusts& borders) {
  json out = json::array();
  for (int a = 0; a < borders.classes(); ++a) {
    for (int b = a + 1; b < borders.classes(); ++b) {
      const BorderTrust& trust = borders.Of(a, b);
      if (trust.weight > 0) out.push_back({a, b, trust.bias_px, trust.sigma_px, trust.weight});
    }
  }
  return out;
}

BorderTrusts BordersFromArray(const json& j, int classes) {
  BorderTrusts borders(classes);
  for (const json& item : j) {
    const int a = item.at(0), b = item.at(1);
    const BorderTrust trust = {item.at(2), item.at(3), item.at(4)};
    const bool known = a >= 0 && a < b && b < classes;
    if (!known || !(trust.weight > 0 && trust.weight <= 1) || !(trust.sigma_px >= 0)) {
      throw json::type_error::create(302, "found " + item.dump() + ", expected [class, class, bias, sigma, weight]",
                                     &item);
    }
    borders.Set(a, b, trust);
  }
  return borders;
}

// Checks that all indices of views and flights are in range.
Status CheckCells(const Survey& s) {
  if (!(s.gsd_m > 0) || !(s.ground.cell_m > 0) || s.cells.empty()) {
    return absl::InvalidArgumentError("survey: expected a positive GSD and cell size and at least one cell");
  }
  const auto check_view = [&](int32_t view) {
    if (view >= 0 && view < static_cast<int32_t>(s.views.size())) return absl::OkStatus();
    return absl::InvalidArgumentError("survey: found view index " + std::to_string(view) + ", expected 0 to " +
                                      std::to_string(static_cast<int64_t>(s.views.size()) - 1));
  };
  for (const SurveyCell& cell : s.cells) {
    if (cell.fine_faces < 0 || cell.fine_faces > std::numeric_limits<uint32_t>::max()) {
      return absl::InvalidArgumentError("survey: found fine_faces " + std::to_string(cell.fine_faces) +
                                        ", expected 0 to 2^32 - 1");
    }
    for (const int32_t view : cell.views) TESSERA_RETURN_IF_ERROR(check_view(view));
  }
  for (const auto& pair : s.pairs) {
    for (const int32_t view : pair) TESSERA_RETURN_IF_ERROR(check_view(view));
  }
  for (const SceneView& view : s.views) {
    if (view.flight >= -1 && view.flight < static_cast<int>(s.flights.size())) continue;
    return absl::InvalidArgumentError("survey: found flight index " + std::to_string(view.flight) +
                                      ", expected -1 to " + std::to_string(static_cast<int64_t>(s.flights.size()) - 1));
  }
  if (s.view_depths.size() != s.views.size()) {
    return absl::InvalidArgumentError("survey: found depths of " + std::to_string(s.view_depths.size()) +
                                      " views, expected " + std::to_string(s.views.size()));
  }
  return absl::OkStatus();
}

template <class Value, class Convert>
StatusOr<Value> Parse(const std::string& text, const std::string& what, const Convert& convert) {
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth(what, text));
  try {
    return convert(json::parse(text));
  } catch (const json::exception& e) {
    return absl::InvalidArgumentError(what + ": " + e.what());
  }
}

template <class Value>
StatusOr<Value> ParsePart(const std::string& text, const std::string& what) {
  return Parse<Value>(text, what, [](const json& j) { return j.get<Value>(); });
}

}  // namespace

// The conversions that the JSON library finds by the type of their argument.

static void to_json(json& j, const PinholeCamera& c) { j = {c.width, c.height, c.fx, c.fy, c.cx, c.cy}; }
static void from_json(const json& j, PinholeCamera& c) { c = {j.at(0), j.at(1), j.at(2), j.at(3), j.at(4), j.at(5)}; }

static void to_json(json& j, const LikelihoodForm& form) {
  j = {{"layout", static_cast<int>(form.layout)}, {"values", static_cast<int>(form.values)}, {"colors", form.colors}};
  if (form.first_id) j["first_id"] = *form.first_id;
}
static void from_json(const json& j, LikelihoodForm& form) {
  form.layout = static_cast<LikelihoodForm::Layout>(j.at("layout").get<int>());
  form.values = static_cast<LikelihoodForm::Values>(j.at("values").get<int>());
  j.at("colors").get_to(form.colors);
  if (const auto first = j.find("first_id"); first != j.end()) form.first_id = first->get<int>();
}

static void to_json(json& j, const SceneView& view) {
  j = {{"name", view.name},
       {"image", view.image_path},
       {"likelihood", view.likelihood_path},
       {"flight", view.flight},
       {"image_content", view.image_content},
       {"likelihood_content", view.likelihood_content},
       {"withdrawn", view.withdrawn},
       {"lens",
        {{"kind", static_cast<int>(view.lens.kind)},
         {"pinhole", view.lens.pinhole},
         {"coefficients", view.lens.coefficients}}},
       {"intrinsics", view.camera.intrinsics},
       {"rotation_cam_from_local", MatrixToJson(view.camera.rotation_cam_from_world)},
       {"translation_cam_from_local", VectorToJson(view.camera.translation_cam_from_world)}};
  if (!view.mask_path.empty()) j["mask"] = view.mask_path;
  if (view.masked) j["masked"] = true;
  if (view.white_level > 0) j["white_level"] = view.white_level;
  if (view.likelihood_form != LikelihoodForm()) j["likelihood_form"] = view.likelihood_form;
}
static void from_json(const json& j, SceneView& view) {
  view.name = j.at("name");
  view.image_path = j.at("image");
  view.likelihood_path = j.at("likelihood");
  view.flight = j.at("flight");
  view.image_content = j.at("image_content");
  view.likelihood_content = j.at("likelihood_content");
  if (const auto form = j.find("likelihood_form"); form != j.end()) form->get_to(view.likelihood_form);
  view.withdrawn = j.at("withdrawn");
  view.mask_path = j.value("mask", std::string());
  view.masked = j.value("masked", false);
  view.white_level = j.value("white_level", 0);
  const json& lens = j.at("lens");
  view.lens.kind = static_cast<LensModel::Kind>(lens.at("kind").get<int>());
  view.lens.pinhole = lens.at("pinhole");
  lens.at("coefficients").get_to(view.lens.coefficients);
  view.camera.intrinsics = j.at("intrinsics");
  view.camera.rotation_cam_from_world = MatrixFromJson(j.at("rotation_cam_from_local"));
  view.camera.translation_cam_from_world = VectorFromJson(j.at("translation_cam_from_local"));
}

static void to_json(json& j, const SceneClass& c) {
  j = {{"name", c.name},
       {"color_rgb", c.color_rgb},
       {"prior_alpha_rad", c.prior_alpha_rad},
       {"prior_beta_rad", c.prior_beta_rad},
       {"smoothness", c.smoothness},
       {"keep", c.anchor_weight}};
}
static void from_json(const json& j, SceneClass& c) {
  c.name = j.at("name");
  j.at("color_rgb").get_to(c.color_rgb);
  c.prior_alpha_rad = j.at("prior_alpha_rad");
  c.prior_beta_rad = j.at("prior_beta_rad");
  c.smoothness = j.at("smoothness");
  c.anchor_weight = j.value("keep", 0.0);  // absent in surveys before version 19
}

static void to_json(json& j, const Crs& crs) {
  j = {{"kind", static_cast<int>(crs.kind)}, {"lat_rad", crs.lat_rad}, {"lon_rad", crs.lon_rad},
       {"height_m", crs.height_m},           {"zone", crs.zone},       {"north", crs.north}};
  if (crs.kind == Crs::Kind::kProjected) {
    j["epsg"] = crs.epsg;
    j["vertical_epsg"] = crs.vertical_epsg;
  }
}
static void from_json(const json& j, Crs& crs) {
  crs = {static_cast<Crs::Kind>(j.at("kind").get<int>()),
         j.at("lat_rad"),
         j.at("lon_rad"),
         j.at("height_m"),
         j.at("zone"),
         j.at("north"),
         j.value("epsg", 0),
         j.value("vertical_epsg", 0)};
}

static void to_json(json& j, const SurveyCell& cell) {
  j = {{"x", cell.x},
       {"y", cell.y},
       {"faces", cell.faces},
       {"reach_m", cell.reach_m},
       {"box_min", VectorToJson(cell.box_min)},
       {"box_max", VectorToJson(cell.box_max)},
       {"views", cell.views}};
  if (cell.fine_faces > 0) j["fine_faces"] = cell.fine_faces;
}
static void from_json(const json& j, SurveyCell& cell) {
  cell.x = j.at("x");
  cell.y = j.at("y");
  cell.faces = j.at("faces");
  cell.fine_faces = j.value("fine_faces", int64_t{0});
  cell.reach_m = j.at("reach_m");
  cell.box_min = VectorFromJson(j.at("box_min"));
  cell.box_max = VectorFromJson(j.at("box_max"));
  j.at("views").get_to(cell.views);
}

static void to_json(json& j, const Flight& flight) { j = {{"name", flight.name}, {"date", flight.date}}; }
static void from_json(const json& j, Flight& flight) { flight = {j.at("name"), j.at("date")}; }

static void from_json(const json& j, Survey& s) {
  s.scene_name = j.at("scene_name");
  s.mesh_path = j.at("mesh");
  if (const auto property = j.find("label_property"); property != j.end()) {
    s.label_property = property->get<std::string>();
  }
  s.gsd_m = j.at("gsd_m");
  s.up = VectorFromJson(j.at("up"));
  s.ground.axis_x = VectorFromJson(j.at("ground_axis_x"));
  s.ground.axis_y = VectorFromJson(j.at("ground_axis_y"));
  s.ground.cell_m = j.at("cell_m");
  j.at("cells").get_to(s.cells);
  j.at("views").get_to(s.views);
  j.at("view_depths").get_to(s.view_depths);
  j.at("flights").get_to(s.flights);
  j.at("pairs").get_to(s.pairs);
  j.at("classes").get_to(s.classes);
  s.has_likelihoods = j.at("has_likelihoods");
  s.classifier = j.value("classifier", std::string());
  s.borders = BordersFromArray(j.at("borders"), static_cast<int>(s.classes.size()));
  s.has_labels = j.at("has_labels");
  s.source = j.value("source", std::string());
  s.fit = j.value("fit", std::string());
  s.crs = j.at("crs");
  s.origin_in_scene = VectorFromJson(j.at("origin_in_scene"));
  s.rotation_local_from_scene = MatrixFromJson(j.at("rotation_local_from_scene"));
  s.input_vertices = j.at("input_vertices");
  s.input_faces = j.at("input_faces");
  s.vertices = j.at("vertices");
  s.faces = j.at("faces");
  j.at("warnings").get_to(s.warnings);
  s.skipped_images = j.value("skipped_images", std::vector<std::pair<std::string, std::string>>());
  if (const json& revision = j.at("revision"); !revision.is_null()) {
    s.revision = {revision.at("first_new_face"), revision.at("cells").get<std::vector<std::array<int, 2>>>()};
  }
}

bool IsRevised(const Survey& survey, int x, int y) {
  return survey.revision &&
         std::binary_search(survey.revision->cells.begin(), survey.revision->cells.end(), std::array<int, 2>{x, y});
}

void FillViewDepths(Survey* survey) {
  survey->view_depths.resize(survey->views.size(), {0, 0});
  for (const SurveyCell& cell : survey->cells) {
    const Eigen::AlignedBox3d box(cell.box_min, cell.box_max);
    for (const int32_t view : cell.views) {
      auto& [near_m, far_m] = survey->view_depths[view];
      for (int k = 0; k < 8; ++k) {
        const auto corner = box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(k));
        const double depth_m = std::max(0.0, survey->views[view].camera.CameraFromWorld(corner).z());
        near_m = far_m == 0 ? depth_m : std::min(near_m, depth_m);
        far_m = std::max(far_m, depth_m);
      }
    }
  }
}

Survey WithoutNames(Survey survey) {
  survey.scene_name.clear();
  survey.mesh_path.clear();
  survey.label_property.reset();
  survey.flights.clear();
  survey.warnings.clear();
  survey.source.clear();
  survey.fit.clear();
  survey.skipped_images.clear();
  survey.revision.reset();
  for (size_t v = 0; v < survey.views.size(); ++v) {
    SceneView& view = survey.views[v];
    view.name.clear();
    view.flight = -1;
    if (!view.image_path.empty()) view.image_path = ViewFileName(static_cast<int32_t>(v), false);
    const bool made = !survey.classifier.empty() && !view.withdrawn;
    if (!view.mask_path.empty()) view.mask_path = ViewMaskName(static_cast<int32_t>(v));
    if (made || !view.likelihood_path.empty()) view.likelihood_path = ViewFileName(static_cast<int32_t>(v), true);
  }
  return survey;
}

std::string ClassifiedContent(const Survey& survey, const std::string& pixels) {
  const std::string both = survey.classifier + " " + pixels;
  return Xxh3Hex(both.data(), both.size());
}

std::string SurveyToJson(const Survey& s) {
  json revision;
  if (s.revision) revision = {{"first_new_face", s.revision->first_new_face}, {"cells", s.revision->cells}};
  json out = {{"scene_name", s.scene_name},
              {"mesh", s.mesh_path},
              {"flights", s.flights},
              {"gsd_m", s.gsd_m},
              {"up", VectorToJson(s.up)},
              {"ground_axis_x", VectorToJson(s.ground.axis_x)},
              {"ground_axis_y", VectorToJson(s.ground.axis_y)},
              {"cell_m", s.ground.cell_m},
              {"cells", s.cells},
              {"views", s.views},
              {"view_depths", s.view_depths},
              {"pairs", s.pairs},
              {"revision", std::move(revision)},
              {"classes", s.classes},
              {"has_likelihoods", s.has_likelihoods},
              {"borders", BorderArray(s.borders)},
              {"has_labels", s.has_labels},
              {"crs", s.crs},
              {"origin_in_scene", VectorToJson(s.origin_in_scene)},
              {"rotation_local_from_scene", MatrixToJson(s.rotation_local_from_scene)},
              {"input_vertices", s.input_vertices},
              {"input_faces", s.input_faces},
              {"vertices", s.vertices},
              {"faces", s.faces},
              {"warnings", s.warnings}};
  if (!s.classifier.empty()) out["classifier"] = s.classifier;
  if (!s.source.empty()) out["source"] = s.source;
  if (!s.fit.empty()) out["fit"] = s.fit;
  if (s.label_property) out["label_property"] = *s.label_property;
  if (!s.skipped_images.empty()) out["skipped_images"] = s.skipped_images;
  return out.dump();
}

StatusOr<Survey> ParseSurvey(const std::string& text) {
  TESSERA_ASSIGN_OR_RETURN(Survey survey, ParsePart<Survey>(text, "survey"));
  TESSERA_RETURN_IF_ERROR(CheckCells(survey));
  return survey;
}

std::string ViewsToJson(const std::vector<SceneView>& views) { return json(views).dump(); }

StatusOr<std::vector<SceneView>> ParseViews(const std::string& text) {
  return ParsePart<std::vector<SceneView>>(text, "views");
}

std::string BordersToJson(const BorderTrusts& borders) { return BorderArray(borders).dump(); }

StatusOr<BorderTrusts> ParseBorders(const std::string& text, size_t classes) {
  return Parse<BorderTrusts>(text, "borders",
                             [&](const json& j) { return BordersFromArray(j, static_cast<int>(classes)); });
}

std::string ClassesToJson(const std::vector<SceneClass>& classes) { return json(classes).dump(); }

StatusOr<std::vector<SceneClass>> ParseClasses(const std::string& text) {
  return ParsePart<std::vector<SceneClass>>(text, "classes");
}

}  // namespace tessera
