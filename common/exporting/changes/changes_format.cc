#include "common/exporting/changes/changes_format.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "common/base/json_bounds.h"
#include "common/exporting/export_map.h"
#include "common/geodesy/reference_system.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

using ChangesJson = nlohmann::ordered_json;

constexpr char kChangesFile[] = "changes.geojson";

// From the coordinates of changes.geojson to those asked for. The file has no heights: points are taken at that of the
// frame's origin, which moves points of a map projection by nothing.
class ChangesMap {
 public:
  static StatusOr<ChangesMap> Open(const ExportScene& scene, const std::string& crs, bool from_geographic) {
    ChangesMap map;
    map.scene_ = &scene;
    if (from_geographic) {
      TESSERA_ASSIGN_OR_RETURN(map.from_, ExportMap::Open(scene, "EPSG:4326"));
      TESSERA_ASSIGN_OR_RETURN(const Eigen::Vector3d origin, scene.frame.GeodeticFromLocal(Eigen::Vector3d::Zero()));
      map.height_m_ = origin.z();
    }
    TESSERA_ASSIGN_OR_RETURN(map.to_, ExportMap::Open(scene, crs));
    TESSERA_ASSIGN_OR_RETURN(const ReferenceSystem system, ReferenceSystem::Parse(crs));
    map.unit_ = system.kind() == ReferenceSystem::Kind::kGeographic ? 1e8 : 1e3;
    return map;
  }

  // Converts the points of arrays of arrays, at any depth. Throws an exception of the JSON library if it is no such
  // array.
  Status Convert(ChangesJson* json) const {
    if (!json->at(0).is_number()) {
      for (ChangesJson& part : *json) TESSERA_RETURN_IF_ERROR(Convert(&part));
      return absl::OkStatus();
    }
    Eigen::Vector3d p(json->at(0).get<double>(), json->at(1).get<double>(), height_m_);
    if (from_) {
      TESSERA_RETURN_IF_ERROR(from_->ToLocal({&p, 1}));
    } else {
      p = scene_->frame.LocalFromScene({p.x(), p.y(), scene_->frame.origin_in_scene().z()});
    }
    TESSERA_RETURN_IF_ERROR(to_->FromLocal({&p, 1}));
    *json = {std::round(p.x() * unit_) / unit_, std::round(p.y() * unit_) / unit_};
    return absl::OkStatus();
  }

 private:
  const ExportScene* scene_ = nullptr;
  std::optional<ExportMap> from_, to_;  // from_: none if the file has the scene's coordinates
  double height_m_ = 0;                 // above the ellipsoid
  double unit_ = 1;                     // coordinates are multiples of its inverse: 1e-8 degrees or a millimetre
};

// "urn:ogc:def:crs:EPSG::32633" of "EPSG:32633+5773"; empty for other systems.
std::string CrsUrn(const std::string& crs) {
  constexpr char kAuthority[] = "EPSG:";
  if (!absl::StartsWithIgnoreCase(crs, kAuthority)) return "";
  const std::string code = crs.substr(sizeof(kAuthority) - 1, crs.find('+') - (sizeof(kAuthority) - 1));
  return absl::StrCat("urn:ogc:def:crs:EPSG::", code);
}

StatusOr<std::string> ConvertChanges(const std::string& text, const std::string& path, const ExportScene& scene,
                                     const std::string& crs) {
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth(path, text));
  try {
    const ChangesJson read = ChangesJson::parse(text);
    const bool from_geographic = read.at("tessera_coordinates") == "wgs84";
    TESSERA_ASSIGN_OR_RETURN(const ChangesMap map, ChangesMap::Open(scene, crs, from_geographic));
    ChangesJson written = {{"type", read.at("type")}};
    const std::string urn = CrsUrn(crs);
    if (!urn.empty()) written["crs"] = {{"type", "name"}, {"properties", {{"name", urn}}}};
    written["tessera_coordinates"] = crs;
    written["features"] = read.at("features");
    for (ChangesJson& feature : written["features"]) {
      ChangesJson& coordinates = feature.at("geometry").at("coordinates");
      for (ChangesJson& ring : coordinates) {
        if (!ring.empty()) TESSERA_RETURN_IF_ERROR(map.Convert(&ring));
      }
    }
    return written.dump(1, ' ', false, ChangesJson::error_handler_t::replace) + "\n";
  } catch (const ChangesJson::exception& error) {
    return InputError(path, "", std::string(error.what()), "the change report of an update");
  }
}

}  // namespace

StatusOr<std::vector<std::string>> JoinChanges(const JoinInput& input, const std::string& folder,
                                               const TaskControl& control) {
  if (input.changes_path.empty()) {
    return absl::InvalidArgumentError(
        "formats: found changes for a result without changes.geojson, expected the result of `tessera update` with a "
        "new flight: only that has one");
  }
  TESSERA_RETURN_IF_ERROR(control.Check());
  TESSERA_ASSIGN_OR_RETURN(std::string text, ReadFile(input.changes_path));
  if (!input.options.crs.empty()) {
    TESSERA_ASSIGN_OR_RETURN(text, ConvertChanges(text, input.changes_path, input.scene, input.options.crs));
  }
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(absl::StrCat(folder, "/", kChangesFile), text));
  return std::vector<std::string>{kChangesFile};
}

}  // namespace tessera
