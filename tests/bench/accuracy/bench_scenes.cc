#include "tests/bench/accuracy/bench_scenes.h"

#include <filesystem>
#include <sstream>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "common/base/task_control.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr char kDescriptionFile[] = "bench_options.txt";

// images.txt without the image `name`, whose id goes to `id`.
std::string WithoutImage(const std::string& images, const std::string& name, std::string* id) {
  std::istringstream in(images);
  std::string out, line;
  while (std::getline(in, line)) {
    if (!line.empty() && line[0] != '#' && absl::EndsWith(line, absl::StrCat(" ", name))) {
      *id = line.substr(0, line.find(' '));
      std::getline(in, line);  // its points
      continue;
    }
    absl::StrAppend(&out, line, "\n");
    if (line.empty() || line[0] == '#') continue;
    if (std::getline(in, line)) absl::StrAppend(&out, line, "\n");
  }
  return out;
}

// points3D.txt without the image `id` in its tracks, and without points that have no other image.
std::string WithoutTracks(const std::string& points, const std::string& id) {
  std::istringstream in(points);
  std::string out, line;
  while (std::getline(in, line)) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream words(line);
    std::string word, kept, index;
    for (int k = 0; k < 8 && words >> word; ++k) absl::StrAppend(&kept, k > 0 ? " " : "", word);
    int images = 0;
    while (words >> word >> index) {
      if (word == id) continue;
      absl::StrAppend(&kept, " ", word, " ", index);
      ++images;
    }
    if (images > 0) absl::StrAppend(&out, kept, "\n");
  }
  return out;
}

}  // namespace

Status LinkScene(const SceneDescription& scene, const std::string& changed, const std::string& folder) {
  if (changed.empty() || changed.find('/') != std::string::npos) {
    return absl::UnimplementedError(absl::StrCat(scene.folder, ": '", changed, "' does not lie in the scene's folder"));
  }
  TESSERA_RETURN_IF_ERROR(RemoveTree(folder));
  TESSERA_RETURN_IF_ERROR(EnsureFolder(folder));
  for (const auto& entry : fs::directory_iterator(scene.folder)) {
    if (entry.path().filename() == changed) continue;
    fs::create_symlink(fs::absolute(entry.path()), fs::path(folder) / entry.path().filename());
  }
  return absl::OkStatus();
}

Status EnsureCity(const SynthOptions& options, const std::string& folder) {
  const std::string description =
      absl::StrCat(options.columns, "x", options.rows, " seed ", options.seed, " gsd ", options.gsd_m, " image ",
                   options.image_width_px, "x", options.image_height_px, "\n");
  const std::string note = absl::StrCat(folder, "/", kDescriptionFile);
  if (fs::exists(note)) {
    TESSERA_ASSIGN_OR_RETURN(const std::string found, ReadFile(note));
    if (found == description) return absl::OkStatus();
  }
  TESSERA_RETURN_IF_ERROR(RemoveTree(folder));
  TESSERA_RETURN_IF_ERROR(SynthesizeCity(options, folder, TaskControl()).status());
  return WriteFileAtomic(note, description);
}

Status StartFromTruth(const SceneDescription& scene, const std::string& folder) {
  TESSERA_RETURN_IF_ERROR(LinkScene(scene, scene.mesh_path, folder));
  fs::create_symlink(fs::absolute(fs::path(scene.folder) / "truth" / "mesh.ply"), fs::path(folder) / scene.mesh_path);
  return absl::OkStatus();
}

Status LeaveOutView(const SceneDescription& scene, size_t view, const std::string& folder) {
  TESSERA_RETURN_IF_ERROR(LinkScene(scene, scene.cameras_folder, folder));
  const std::string from = absl::StrCat(scene.folder, "/", scene.cameras_folder);
  const std::string to = absl::StrCat(folder, "/", scene.cameras_folder);
  TESSERA_RETURN_IF_ERROR(EnsureFolder(to));
  TESSERA_ASSIGN_OR_RETURN(const std::string cameras, ReadFile(from + "/cameras.txt"));
  TESSERA_ASSIGN_OR_RETURN(const std::string images, ReadFile(from + "/images.txt"));
  TESSERA_ASSIGN_OR_RETURN(const std::string points, ReadFile(from + "/points3D.txt"));
  std::string id;
  const std::string kept = WithoutImage(images, scene.views[view].name, &id);
  if (id.empty()) return absl::NotFoundError(absl::StrCat(from, "/images.txt has no ", scene.views[view].name));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(to + "/cameras.txt", cameras));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(to + "/images.txt", kept));
  return WriteFileAtomic(to + "/points3D.txt", WithoutTracks(points, id));
}

}  // namespace tessera
