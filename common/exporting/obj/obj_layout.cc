#include "common/exporting/obj/obj_layout.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "common/base/printable.h"
#include "common/scene/scene_json.h"
#include "common/storage/xml_file.h"

namespace tessera {
namespace {

constexpr size_t kMaxObjNameBytes = 200;  // the ending and what a temporary name adds fit into 255 too

bool IsObjFileName(const std::string& name) {
  return !name.empty() && name.size() <= kMaxObjNameBytes && name != "." && name != ".." &&
         std::none_of(name.begin(), name.end(), [](char c) {
           return static_cast<unsigned char>(c) < ' ' || c == '\x7f' || c == '/' || c == '\\';
         });
}

// The shortest text without exponent that is read as the same number.
std::string ObjNumber(double value) {
  char text[400];
  const std::to_chars_result end = std::to_chars(text, text + sizeof(text), value, std::chars_format::fixed);
  return std::string(text, end.ptr);
}

// A system may be text of several lines.
std::string OnOneLine(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < ' '; }, ' ');
  return text;
}

// The system of a scene's coordinates as text; empty: local, or heights differ from those of the system by a number.
std::string ObjSystemText(const Crs& crs) {
  const auto json = nlohmann::json::parse(CrsToJson(crs));
  switch (crs.kind) {
    case Crs::Kind::kLocal:
      return "";
    case Crs::Kind::kEnu: {
      const std::string place = absl::StrCat("ENU:", ObjNumber(json.at("lat_deg").get<double>()), ",",
                                             ObjNumber(json.at("lon_deg").get<double>()));
      return crs.height_m == 0 ? place : absl::StrCat(place, ",", ObjNumber(crs.height_m));
    }
    case Crs::Kind::kUtm:
      return absl::StrCat("EPSG:", (crs.north ? 32600 : 32700) + crs.zone);
    case Crs::Kind::kEcef:
      return "EPSG:4978";
    case Crs::Kind::kProjected:
      if (crs.height_m != 0) return "";
      return crs.vertical_epsg == 0 ? absl::StrCat("EPSG:", crs.epsg)
                                    : absl::StrCat("EPSG:", crs.epsg, "+", crs.vertical_epsg);
  }
  return "";
}

}  // namespace

std::string ObjTilePath(std::string_view name) {
  const std::string text(name);
  return absl::StrCat("Data/", text, "/", text);
}

StatusOr<ExportMap> OpenObjMap(const ExportScene& scene, const ExportOptions& options) {
  return ExportMap::Open(scene, options.crs.empty() && !scene.source ? ObjSystemText(scene.frame.crs()) : options.crs);
}

StatusOr<std::vector<std::string>> ObjTilePaths(const ExportScene& scene) {
  std::vector<std::string> paths;
  if (!scene.source) return paths;
  const std::vector<std::string>& names = scene.source->tiles;
  const bool have_folders =
      std::any_of(names.begin(), names.end(), [](const std::string& name) { return name.find('/') != name.npos; });
  Faults faults;
  std::set<std::string> known;
  for (size_t k = 0; k < names.size(); ++k) {
    const std::vector<std::string> parts = absl::StrSplit(names[k], '/');
    const std::string location = absl::StrCat("source.tiles[", k, "]");
    if (!std::all_of(parts.begin(), parts.end(), IsObjFileName)) {
      faults.Add(InputError("scene.json", location, JsonQuoted(Prefix(names[k], 2 * kMaxObjNameBytes)),
                            "the name of a file, without '..', '\\' and control characters"));
    } else if (!known.insert(names[k]).second) {
      faults.Add(InputError("scene.json", location, JsonQuoted(names[k]), "a name that no other tile has"));
    }
    paths.push_back(have_folders ? absl::StrCat("Data/", names[k]) : ObjTilePath(names[k]));
  }
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  if (names.size() > 1 && scene.source->tile_rects.empty()) paths.clear();
  return paths;
}

StatusOr<Eigen::Vector3d> ObjOffset(const ExportScene& scene, const ExportMap& map) {
  if (scene.source && map.crs() == scene.source->crs) return scene.source->offset;
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  if (scene.frame.crs().kind == Crs::Kind::kLocal) return offset;
  TESSERA_RETURN_IF_ERROR(map.FromLocal({&offset, 1}));
  for (double& coordinate : offset) coordinate = std::abs(coordinate) < 1e4 ? 0 : std::round(coordinate / 1e3) * 1e3;
  return offset;
}

std::string ObjMetadata(const ExportMap& map, const Eigen::Vector3d& offset) {
  const bool has_system = !map.crs().empty() && map.crs() != "local";
  if (!has_system && offset.isZero(0)) return "";
  std::string text = "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<ModelMetadata version=\"1\">\n";
  if (has_system) absl::StrAppend(&text, "  <SRS>", EscapeMarkup(OnOneLine(map.crs())), "</SRS>\n");
  absl::StrAppend(&text, "  <SRSOrigin>", ObjNumber(offset.x()), ",", ObjNumber(offset.y()), ",", ObjNumber(offset.z()),
                  "</SRSOrigin>\n</ModelMetadata>\n");
  return text;
}

}  // namespace tessera
