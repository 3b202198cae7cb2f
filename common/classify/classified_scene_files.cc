#include "common/classify/classified_scene_files.h"

#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

// Creates a symbolic link; replaces an existing one.
Status Link(const fs::path& target, const fs::path& link) {
  std::error_code error;
  const fs::path absolute = fs::canonical(target, error);
  if (error) return FileError(error.value(), absl::StrCat(target.string(), ": cannot resolve the path"));
  if (fs::is_symlink(link)) fs::remove(link, error);
  fs::create_symlink(absolute, link, error);
  if (error) return FileError(error.value(), absl::StrCat(link.string(), ": cannot create a symbolic link"));
  return absl::OkStatus();
}

// The images folder: the image path of a view without its name.
std::string ImagesFolder(const SceneDescription& scene) {
  const SceneView& view = scene.views.front();
  return view.image_path.substr(0, view.image_path.size() - view.name.size());
}

}  // namespace

Status CheckClassifiedFolder(const std::string& folder) {
  static const std::set<std::string> known = {"scene.json", "report.json", "appearance", "geometry",
                                              "cameras",    "images",      "masks",      "mesh.ply"};
  std::error_code error;
  if (!fs::exists(folder, error)) return absl::OkStatus();
  const bool earlier = fs::is_symlink(fs::path(folder) / "mesh.ply") || fs::is_empty(folder, error);
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    if (earlier && known.contains(entry.path().filename().string())) continue;
    return absl::AlreadyExistsError(absl::StrCat(folder, ": found ", entry.path().filename().string(),
                                                 ", expected a new or empty folder, or one that tessera classify "
                                                 "wrote: choose another folder"));
  }
  if (error) return FileError(error.value(), absl::StrCat(folder, ": cannot list the folder"));
  return absl::OkStatus();
}

Status WriteClassifiedScene(const SceneDescription& scene, const std::string& scene_file, const std::string& folder,
                            const std::string& source) {
  TESSERA_RETURN_IF_ERROR(EnsureFolder(folder));
  const fs::path from(scene.folder), to(folder);
  TESSERA_RETURN_IF_ERROR(Link(from / scene.cameras_folder, to / "cameras"));
  TESSERA_RETURN_IF_ERROR(Link(from / ImagesFolder(scene), to / "images"));
  TESSERA_RETURN_IF_ERROR(Link(from / scene.mesh_path, to / "mesh.ply"));
  TESSERA_ASSIGN_OR_RETURN(const std::string text, ReadFile(scene_file));
  Json json = Json::parse(text, nullptr, false);
  if (!json.is_object())
    return InputError(scene_file, "", "no JSON object", "an unchanged scene.json: it changed while it was used");
  const std::string masks = json.value("masks", std::string("masks"));
  if (fs::is_directory(from / masks)) {
    TESSERA_RETURN_IF_ERROR(Link(from / masks, to / "masks"));
    json["masks"] = "masks";
  }
  json["name"] = scene.name;
  json["cameras"] = "cameras";
  json["images"] = "images";
  json["mesh"] = "mesh.ply";
  if (!scene.label_property) json.erase("label_property");  // the mesh may be another than the scene's
  json["likelihoods"] = "geometry";
  json["likelihoods_source"] = source;
  return WriteFileAtomic((to / "scene.json").string(), json.dump(2) + "\n");
}

}  // namespace tessera
