#include "common/scene/scene_json.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "common/base/json_bounds.h"

namespace tessera {
namespace {

using Json = nlohmann::json;

constexpr double kRadiansPerDegree = std::numbers::pi / 180;
constexpr int kMaxEpsg = 999999;
constexpr size_t kMaxCrsBytes = 65536;

std::string Excerpt(const Json& value) {
  const std::string text = value.dump(-1, ' ', false, Json::error_handler_t::replace);
  return text.size() <= 60 ? text : text.substr(0, 57) + "...";
}

// Reads the keys of one JSON object; RejectUnknownKeys reports the keys that were not read.
class ObjectReader {
 public:
  ObjectReader(const Json& object, std::string location, const std::string& file, Faults* faults)
      : object_(object), location_(std::move(location)), file_(file), faults_(*faults) {}

  const Json* Find(const std::string& key) {
    known_.push_back(key);
    const auto it = object_.find(key);
    return it == object_.end() ? nullptr : &*it;
  }
  std::string KeyLocation(const std::string& key) const {
    return location_.empty() ? key : absl::StrCat(location_, ".", key);
  }
  void Fault(const std::string& key, const Json& found, const std::string& expected) {
    faults_.Add(InputError(file_, KeyLocation(key), Excerpt(found), expected));
  }

  bool String(const std::string& key, std::string* out) {
    const Json* value = Find(key);
    if (value == nullptr) return false;
    if (!value->is_string()) {
      Fault(key, *value, "a string");
      return false;
    }
    *out = value->get<std::string>();
    return true;
  }
  bool Number(const std::string& key, double low, double high, double* out) {
    const Json* value = Find(key);
    if (value == nullptr) return false;
    if (!value->is_number() || !(value->get<double>() >= low && value->get<double>() <= high)) {
      Fault(key, *value, absl::StrCat("a number from ", low, " to ", high));
      return false;
    }
    *out = value->get<double>();
    return true;
  }
  void Path(const std::string& key, ScenePath* out) {
    if (!String(key, &out->path)) return;
    out->given = true;
    if (out->path.empty() || out->path.front() == '/' ||
        absl::StrCat("/", out->path, "/").find("/../") != std::string::npos) {
      Fault(key, out->path, "a path inside the scene's folder");
    }
    out->path = std::filesystem::path(out->path).lexically_normal().generic_string();  // "./images//" is "images"
    if (out->path.size() > 1 && out->path.back() == '/') out->path.pop_back();
  }
  void RejectUnknownKeys() {
    for (const auto& [key, value] : object_.items()) {
      if (std::find(known_.begin(), known_.end(), key) == known_.end()) {
        faults_.Add(InputError(file_, location_, absl::StrCat("unknown key '", key, "'"),
                               absl::StrCat("one of ", absl::StrJoin(known_, ", "))));
      }
    }
  }

 private:
  const Json& object_;
  std::string location_;
  const std::string& file_;
  Faults& faults_;
  std::vector<std::string> known_;
};

SceneClass MakeClass(const char* name, std::array<uint8_t, 3> color, double alpha_deg, double beta_deg,
                     double smoothness) {
  return {name, color, alpha_deg * kRadiansPerDegree, beta_deg * kRadiansPerDegree, smoothness};
}

bool ParseColor(const std::string& text, std::array<uint8_t, 3>* color) {
  if (text.size() != 7 || text[0] != '#' || text.find_first_not_of("0123456789abcdefABCDEF", 1) != std::string::npos) {
    return false;
  }
  for (int k = 0; k < 3; ++k) (*color)[k] = static_cast<uint8_t>(std::stoi(text.substr(1 + 2 * k, 2), nullptr, 16));
  return true;
}

SceneClass ClassOfName(const std::string& name) {
  for (const SceneClass& known : KnownClasses()) {
    if (known.name == name) return known;
  }
  SceneClass other;
  other.name = name;
  return other;
}

void ParseClasses(const Json& value, const std::string& file, SceneFile* scene, Faults* faults) {
  scene->classes_given = true;
  scene->classes.clear();
  if (!value.is_array() || value.empty() || value.size() > 254) {
    faults->Add(InputError(file, "classes", Excerpt(value), "a list of 1 to 254 classes"));
    return;
  }
  std::set<std::string> names;
  for (size_t i = 0; i < value.size(); ++i) {
    const std::string location = absl::StrCat("classes[", i, "]");
    SceneClass entry;
    if (value[i].is_string()) {
      const std::string name = value[i].get<std::string>();
      entry = ClassOfName(name);
      const auto& known = KnownClasses();
      if (std::none_of(known.begin(), known.end(), [&](const SceneClass& c) { return c.name == name; })) {
        faults->Add(InputError(file, location, Excerpt(value[i]),
                               "ground, facade, roof or vegetation, or an object {\"name\": ...}"));
      }
    } else if (value[i].is_object()) {
      ObjectReader in(value[i], location, file, faults);
      std::string name, color;
      if (!in.String("name", &name) || name.empty()) {
        faults->Add(InputError(file, location, Excerpt(value[i]), "a class with a name"));
      }
      entry = ClassOfName(name);
      if (in.String("color", &color) && !ParseColor(color, &entry.color_rgb)) in.Fault("color", color, "\"#rrggbb\"");
      double degrees = 0;
      if (in.Number("prior_alpha_deg", 0, 180, &degrees)) entry.prior_alpha_rad = degrees * kRadiansPerDegree;
      if (in.Number("prior_beta_deg", 0, 180, &degrees)) entry.prior_beta_rad = degrees * kRadiansPerDegree;
      in.Number("smoothness", 0, 1000, &entry.smoothness);
      in.Number("anchor_weight", 0, 1000, &entry.anchor_weight);
      in.RejectUnknownKeys();
    } else {
      faults->Add(InputError(file, location, Excerpt(value[i]), "a class name or an object"));
    }
    if (!entry.name.empty() && !names.insert(entry.name).second) {
      faults->Add(InputError(file, location, absl::StrCat("class '", entry.name, "' again"), "each class once"));
    }
    scene->classes.push_back(std::move(entry));
  }
}

void ParseLabelProperty(const Json& value, const std::string& file, SceneFile* scene, Faults* faults) {
  if (value.is_null()) {
    scene->label_property = "";
  } else if (value.is_string() && !value.get<std::string>().empty()) {
    scene->label_property = value.get<std::string>();
  } else {
    faults->Add(InputError(file, "label_property", Excerpt(value), "the name of a property, or null for no labels"));
  }
}

// The value of `key`, one of two words. None, with a fault unless it is absent, if it is neither.
std::optional<bool> IsSecondWord(ObjectReader* in, const std::string& key, const std::string& first,
                                 const std::string& second) {
  std::string word;
  if (!in->String(key, &word)) return {};
  if (word != first && word != second) {
    in->Fault(key, word, absl::StrCat("\"", first, "\" or \"", second, "\""));
    return {};
  }
  return word == second;
}

void ParseLikelihoodForm(ObjectReader* in, LikelihoodForm* form) {
  if (const auto last = IsSecondWord(in, "likelihood_layout", "chw", "hwc")) {
    form->layout = *last ? LikelihoodForm::Layout::kClassesLast : LikelihoodForm::Layout::kClassesFirst;
  }
  if (const auto logits = IsSecondWord(in, "likelihood_values", "probabilities", "logits")) {
    form->values = *logits ? LikelihoodForm::Values::kLogits : LikelihoodForm::Values::kProbabilities;
  }
  const Json* first_id = in->Find("likelihood_first_id");
  if (first_id == nullptr) return;
  if (*first_id == 0 || *first_id == 1) {
    form->first_id = *first_id == 1 ? 1 : 0;
  } else {
    in->Fault("likelihood_first_id", *first_id, "0 or 1");
  }
}

void ParseCrs(const Json& value, const std::string& file, Crs* crs, Faults* faults) {
  if (!value.is_object()) {
    faults->Add(InputError(file, "crs", Excerpt(value), "an object with a type"));
    return;
  }
  ObjectReader in(value, "crs", file, faults);
  std::string type;
  if (!in.String("type", &type) ||
      (type != "local" && type != "enu" && type != "utm" && type != "ecef" && type != "projected")) {
    faults->Add(InputError(file, "crs.type", type.empty() ? "nothing" : absl::StrCat("'", type, "'"),
                           "local, enu, utm, ecef or projected"));
    return;
  }
  const auto require = [&](const char* key, bool found) {
    if (!found && value.find(key) == value.end()) {
      faults->Add(InputError(file, "crs", absl::StrCat("no ", key),
                             absl::StrCat("a value of ", key, " for type '", type, "'")));
    }
  };
  if (type == "enu") {
    crs->kind = Crs::Kind::kEnu;
    double lat_deg = 0, lon_deg = 0;
    require("lat_deg", in.Number("lat_deg", -90, 90, &lat_deg));
    require("lon_deg", in.Number("lon_deg", -180, 360, &lon_deg));
    in.Number("height_m", -12000, 1e5, &crs->height_m);
    crs->lat_rad = lat_deg * kRadiansPerDegree;
    crs->lon_rad = lon_deg * kRadiansPerDegree;
  } else if (type == "utm") {
    crs->kind = Crs::Kind::kUtm;
    double zone = 0;
    const bool found = in.Number("zone", 1, 60, &zone);
    require("zone", found);
    if (found && zone != std::floor(zone)) in.Fault("zone", zone, "a whole number");
    crs->zone = static_cast<int>(zone);
    if (const Json* north = in.Find("north"); north != nullptr) {
      if (north->is_boolean()) {
        crs->north = north->get<bool>();
      } else {
        in.Fault("north", *north, "true or false");
      }
    }
  } else if (type == "ecef") {
    crs->kind = Crs::Kind::kEcef;
  } else if (type == "projected") {
    crs->kind = Crs::Kind::kProjected;
    const auto code = [&](const char* key, int* out) {
      double number = 0;
      const bool found = in.Number(key, 1, kMaxEpsg, &number);
      if (found && number != std::floor(number)) in.Fault(key, number, "a whole number");
      *out = static_cast<int>(number);
      return found;
    };
    require("epsg", code("epsg", &crs->epsg));
    code("vertical", &crs->vertical_epsg);
    in.Number("geoid_height_m", -1000, 1000, &crs->height_m);
  }
  in.RejectUnknownKeys();
}

// The plan rectangles of `tiles` tiles: four numbers each, or null for a tile without area.
void ParseTileRects(const Json& value, size_t tiles, ObjectReader* in, std::vector<PlanRect>* rects) {
  if (!value.is_array() || value.size() != tiles) {
    return in->Fault("tile_rects", value, absl::StrCat("a list with an entry for each of the ", tiles, " tiles"));
  }
  for (size_t k = 0; k < value.size(); ++k) {
    PlanRect& rect = rects->emplace_back();
    if (value[k].is_null()) continue;
    bool good = value[k].is_array() && value[k].size() == 4;
    for (size_t i = 0; good && i < 4; ++i) good = value[k][i].is_number() && std::isfinite(value[k][i].get<double>());
    if (good)
      rect = {value[k][0].get<double>(), value[k][1].get<double>(), value[k][2].get<double>(),
              value[k][3].get<double>()};
    if (!good || rect.IsEmpty()) {
      in->Fault(absl::StrCat("tile_rects[", k, "]"), value[k],
                "null, or four numbers x0, y0, x1, y1 with x0 < x1 and "
                "y0 < y1");
    }
  }
}

void ParseSource(const Json& value, const std::string& file, SceneFile* scene, Faults* faults) {
  if (!value.is_object()) {
    faults->Add(
        InputError(file, "source", Excerpt(value), "an object with crs, offset, heights, tiles and tile_rects"));
    return;
  }
  ObjectReader in(value, "source", file, faults);
  SceneSource source;
  if (in.String("crs", &source.crs) && source.crs.size() > kMaxCrsBytes) {
    in.Fault("crs", source.crs, absl::StrCat("at most ", kMaxCrsBytes, " bytes"));
  }
  if (const Json* offset = in.Find("offset"); offset != nullptr) {
    bool good = offset->is_array() && offset->size() == 3;
    for (int k = 0; good && k < 3; ++k) {
      good = (*offset)[k].is_number() && std::isfinite((*offset)[k].get<double>());
      if (good) source.offset[k] = (*offset)[k].get<double>();
    }
    if (!good) in.Fault("offset", *offset, "three numbers");
  }
  if (const Json* tiles = in.Find("tiles"); tiles != nullptr) {
    bool good = tiles->is_array();
    for (size_t k = 0; good && k < tiles->size(); ++k) {
      good = (*tiles)[k].is_string() && !(*tiles)[k].get_ref<const std::string&>().empty();
      if (good) source.tiles.push_back((*tiles)[k].get<std::string>());
    }
    if (!good) in.Fault("tiles", *tiles, "a list of names");
  }
  if (const Json* rects = in.Find("tile_rects"); rects != nullptr) {
    ParseTileRects(*rects, source.tiles.size(), &in, &source.tile_rects);
  }
  if (const Json* heights = in.Find("heights"); heights != nullptr) {
    source.heights.ellipsoid = *heights == "ellipsoid";
    if (!source.heights.ellipsoid) in.Fault("heights", *heights, "\"ellipsoid\"");
  }
  if (double geoid_m = 0; in.Number("geoid_height_m", -1000, 1000, &geoid_m)) {
    source.heights.geoid_height_m = geoid_m;
  }
  in.RejectUnknownKeys();
  scene->source = std::move(source);
}

// A number of degrees that reading turns into `angle_rad` again; a short one, if there is one.
double DegreesOf(double angle_rad) {
  const double angle_deg = angle_rad / kRadiansPerDegree;
  const double rounded_deg = std::round(angle_deg * 1e9) / 1e9;
  if (rounded_deg * kRadiansPerDegree == angle_rad) return rounded_deg;
  for (const double end : {-1e3, 1e3}) {
    const double neighbour_deg = std::nextafter(angle_deg, end);
    if (neighbour_deg * kRadiansPerDegree == angle_rad) return neighbour_deg;
  }
  return angle_deg;
}

void ParseUp(const Json& value, const std::string& file, SceneFile* scene, Faults* faults) {
  Eigen::Vector3d up = Eigen::Vector3d::Zero();
  bool good = value.is_array() && value.size() == 3;
  for (int k = 0; good && k < 3; ++k) {
    good = value[k].is_number();
    if (good) up[k] = value[k].get<double>();
  }
  if (!good || !up.allFinite() || !(up.norm() > 1e-9)) {
    faults->Add(InputError(file, "up", Excerpt(value), "three numbers, not all zero"));
    return;
  }
  scene->up = up.normalized();
}

bool IsIsoDate(const std::string& date) {
  const auto digits = [&](size_t at, size_t n) {
    return std::all_of(date.begin() + at, date.begin() + at + n, [](char c) { return c >= '0' && c <= '9'; });
  };
  return date.size() >= 10 && digits(0, 4) && date[4] == '-' && digits(5, 2) && date[7] == '-' && digits(8, 2) &&
         (date.size() == 10 || date[10] == 'T');
}

void ParseFlights(const Json& value, const std::string& file, SceneFile* scene, Faults* faults) {
  scene->flights.clear();
  if (!value.is_array() || value.empty()) {
    faults->Add(InputError(file, "flights", Excerpt(value), "a list of flights"));
    return;
  }
  std::set<std::string> names;
  for (size_t i = 0; i < value.size(); ++i) {
    const std::string location = absl::StrCat("flights[", i, "]");
    if (!value[i].is_object()) {
      faults->Add(InputError(file, location, Excerpt(value[i]), "an object with name, date and images"));
      continue;
    }
    ObjectReader in(value[i], location, file, faults);
    FlightEntry entry;
    if (!in.String("name", &entry.flight.name) || entry.flight.name.empty()) {
      faults->Add(InputError(file, location, Excerpt(value[i]), "a flight with a name"));
    } else if (!names.insert(entry.flight.name).second) {
      faults->Add(
          InputError(file, location, absl::StrCat("flight '", entry.flight.name, "' again"), "each flight once"));
    }
    if (in.String("date", &entry.flight.date) && !entry.flight.date.empty() && !IsIsoDate(entry.flight.date)) {
      in.Fault("date", entry.flight.date, "a date such as 2026-05-14");
    }
    const Json* images = in.Find("images");
    bool good = images == nullptr || images->is_array();
    for (size_t k = 0; good && images != nullptr && k < images->size(); ++k) {
      good = (*images)[k].is_string();
      if (good) entry.patterns.push_back((*images)[k].get<std::string>());
    }
    if (!good) in.Fault("images", *images, "a list of patterns such as \"north/*.jpg\"");
    if (images == nullptr) entry.patterns = {"*"};
    in.RejectUnknownKeys();
    scene->flights.push_back(std::move(entry));
  }
}

// Line and column, both from 1, of the byte at offset `byte`.
std::string LineAndColumn(const std::string& text, size_t byte) {
  const size_t end = std::min(byte, text.size());
  const auto line = 1 + std::count(text.begin(), text.begin() + end, '\n');
  const size_t break_before = end == 0 ? std::string::npos : text.rfind('\n', end - 1);
  return absl::StrCat("line ", line, ", column ", end - (break_before == std::string::npos ? 0 : break_before + 1) + 1);
}

}  // namespace

const std::vector<SceneClass>& KnownClasses() {
  // Priors and colours of the paper, section 3.2.
  static const auto* classes = new std::vector<SceneClass>{
      MakeClass("ground", {128, 128, 128}, 30, 0, 1), MakeClass("facade", {128, 0, 128}, 30, 90, 1),
      MakeClass("roof", {230, 190, 30}, 60, 0, 1), MakeClass("vegetation", {40, 150, 50}, 180, 0, 1)};
  return *classes;
}

SceneFile ParseSceneFile(const std::string& text, const std::string& file, Faults* faults) {
  SceneFile scene;
  scene.classes = KnownClasses();
  scene.flights = {{{"all", ""}, {"*"}}};
  if (const Status deep = CheckJsonDepth(file, text); !deep.ok()) {
    faults->Add(deep);
    return scene;
  }
  Json json;
  try {
    json = Json::parse(text);
  } catch (const Json::parse_error& error) {
    // nlohmann::json counts bytes from 1; an error at the end of the text is at size + 1.
    std::string what = error.what();
    const size_t reason = what.find("syntax error");
    faults->Add(InputError(file, LineAndColumn(text, error.byte == 0 ? 0 : error.byte - 1),
                           reason == std::string::npos ? what : what.substr(reason), "JSON"));
    return scene;
  } catch (const Json::out_of_range&) {
    faults->Add(InputError(file, "", "a number that is too large", "at most 1.7e308"));
    return scene;
  }
  if (!json.is_object()) {
    faults->Add(InputError(file, "line 1", Excerpt(json), "a JSON object"));
    return scene;
  }
  ObjectReader in(json, "", file, faults);
  const Json* version = in.Find("tessera_scene");
  if (version == nullptr || *version != 1) {
    faults->Add(InputError(file, "tessera_scene", version == nullptr ? "nothing" : Excerpt(*version), "1"));
  }
  in.String("name", &scene.name);
  in.Path("cameras", &scene.cameras);
  in.Path("images", &scene.images);
  in.Path("likelihoods", &scene.likelihoods);
  in.Path("masks", &scene.masks);
  in.String("likelihoods_source", &scene.likelihoods_source);
  ParseLikelihoodForm(&in, &scene.likelihood_form);
  in.Path("mesh", &scene.mesh);
  if (const Json* value = in.Find("label_property")) ParseLabelProperty(*value, file, &scene, faults);
  if (const Json* value = in.Find("classes")) ParseClasses(*value, file, &scene, faults);
  if (const Json* value = in.Find("crs")) ParseCrs(*value, file, &scene.crs, faults);
  if (const Json* value = in.Find("source")) ParseSource(*value, file, &scene, faults);
  if (const Json* value = in.Find("up")) ParseUp(*value, file, &scene, faults);
  if (const Json* value = in.Find("flights")) ParseFlights(*value, file, &scene, faults);
  in.RejectUnknownKeys();
  return scene;
}

std::string CrsToJson(const Crs& crs) {
  switch (crs.kind) {
    case Crs::Kind::kLocal:
      break;
    case Crs::Kind::kEnu:
      return Json{{"type", "enu"},
                  {"lat_deg", DegreesOf(crs.lat_rad)},
                  {"lon_deg", DegreesOf(crs.lon_rad)},
                  {"height_m", crs.height_m}}
          .dump();
    case Crs::Kind::kUtm:
      return Json{{"type", "utm"}, {"zone", crs.zone}, {"north", crs.north}}.dump();
    case Crs::Kind::kEcef:
      return Json{{"type", "ecef"}}.dump();
    case Crs::Kind::kProjected: {
      Json json = {{"type", "projected"}, {"epsg", crs.epsg}};
      if (crs.vertical_epsg != 0) json["vertical"] = crs.vertical_epsg;
      if (crs.height_m != 0) json["geoid_height_m"] = crs.height_m;
      return json.dump();
    }
  }
  return Json{{"type", "local"}}.dump();
}

std::string SceneSourceToJson(const SceneSource& source) {
  Json json = {{"crs", source.crs},
               {"offset", {source.offset.x(), source.offset.y(), source.offset.z()}},
               {"tiles", source.tiles}};
  for (const PlanRect& rect : source.tile_rects) {
    json["tile_rects"].push_back(rect.IsEmpty() ? Json(nullptr) : Json{rect.x0, rect.y0, rect.x1, rect.y1});
  }
  if (source.heights.ellipsoid) json["heights"] = "ellipsoid";
  if (source.heights.geoid_height_m) json["geoid_height_m"] = *source.heights.geoid_height_m;
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace tessera
