#include "common/importing/write_scene.h"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "common/colmap/colmap_writer.h"
#include "common/importing/proof/residuals.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

Json ClassesJson(const std::vector<std::string>& names) {
  Json classes = Json::array();
  for (const std::string& name : names) {
    const bool known = std::any_of(KnownClasses().begin(), KnownClasses().end(),
                                   [&](const SceneClass& row) { return row.name == name; });
    classes.push_back(known ? Json(name) : Json{{"name", name}});
  }
  return classes;
}

// The images of the scene, with the ids that they get in its model; 0: left out.
std::vector<uint32_t> IdsOf(const ImportedScene& scene) {
  std::vector<uint32_t> ids(scene.images.size(), 0);
  uint32_t next = 0;
  for (size_t i = 0; i < ids.size(); ++i) {
    if (!scene.images[i].file.empty()) ids[i] = ++next;
  }
  return ids;
}

CalibratedImages ModelOf(const ImportedScene& scene) {
  const ImportedBlock& block = *scene.block;
  const std::vector<uint32_t> ids = IdsOf(scene);
  CalibratedImages model;
  for (size_t i = 0; i < ids.size(); ++i) {
    if (ids[i] == 0) continue;
    const BlockImage& image = block.images[i];
    CalibratedImage out;
    out.id = ids[i];
    out.name = scene.images[i].name;
    out.camera_id = static_cast<uint32_t>(image.camera) + 1;
    out.rotation_cam_from_world = image.rotation_cam_from_block;
    out.translation_cam_from_world = -image.rotation_cam_from_block * image.centre;
    model.cameras.emplace(out.camera_id, block.cameras[image.camera].lens);
    model.images.push_back(std::move(out));
  }
  for (const BlockTiePoint& point : block.points) {
    if (!HasPosition(point)) continue;
    TiePoint out;
    out.id = model.points.size() + 1;
    out.position = point.position;
    for (const BlockObservation& seen : point.observations) {
      const uint32_t id = ids[seen.image];
      if (id == 0) continue;
      out.image_ids.push_back(id);
      model.images[id - 1].observations.push_back({seen.position_px, out.id});
    }
    if (!out.image_ids.empty()) model.points.push_back(std::move(out));
  }
  return model;
}

Status AddImage(const std::string& file, const std::string& path, bool copy) {
  TESSERA_RETURN_IF_ERROR(EnsureFolder(fs::path(path).parent_path().string()));
  if (copy) return CopyFileDurably(file, path);
  std::error_code error;
  const fs::path target = fs::canonical(file, error);
  if (!error) fs::create_symlink(target, path, error);
  if (error) return FileError(error.value(), absl::StrCat(path, ": cannot create a symbolic link"));
  return absl::OkStatus();
}

}  // namespace

StatusOr<FlightPattern> ParseFlightPattern(const std::string& text) {
  const size_t at = text.find('=');
  if (at == std::string::npos || at == 0 || at + 1 == text.size()) {
    return InputError("--flight", "", absl::StrCat("'", text, "'"),
                      "NAME=GLOB: a name and a pattern of names of images, such as may='2026-05/*'");
  }
  return FlightPattern{text.substr(0, at), text.substr(at + 1)};
}

Status WriteScene(const ImportedScene& scene, const std::string& folder) {
  for (const FoundImage& image : scene.images) {
    if (image.file.empty()) continue;
    TESSERA_ASSIGN_OR_RETURN(const std::string path, JoinInside(absl::StrCat(folder, "/images"), image.name));
    TESSERA_RETURN_IF_ERROR(AddImage(image.file, path, scene.copy_images));
  }
  TESSERA_RETURN_IF_ERROR(EnsureFolder(absl::StrCat(folder, "/colmap")));
  TESSERA_RETURN_IF_ERROR(WriteColmapModel(ModelOf(scene), absl::StrCat(folder, "/colmap")));
  Json json;
  json["tessera_scene"] = 1;
  json["name"] = scene.name;
  if (!scene.class_names.empty()) json["classes"] = ClassesJson(scene.class_names);
  json["crs"] = Json::parse(CrsToJson(scene.crs));
  for (const FlightPattern& flight : scene.flights) {
    json["flights"].push_back({{"name", flight.name}, {"images", {flight.images}}});
  }
  if (scene.source) json["source"] = Json::parse(SceneSourceToJson(*scene.source));
  return WriteFileAtomic(absl::StrCat(folder, "/scene.json"), json.dump(2) + "\n");
}

}  // namespace tessera
