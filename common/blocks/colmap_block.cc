// Conventions of COLMAP (https://colmap.github.io/format.html, src/colmap/sensor/models.h), which are those of blocks:
// the quaternion and translation take the world to the camera; x right, y down, z forward; the centre of the first
// pixel is (0.5, 0.5).
#include "common/blocks/colmap_block.h"

#include <filesystem>
#include <map>
#include <set>

#include "absl/strings/str_cat.h"
#include "common/colmap/colmap.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

bool HasColmapFiles(const std::string& folder) {
  for (const char* extension : {".bin", ".txt"}) {
    if (FileExists(absl::StrCat(folder, "/cameras", extension)) &&
        FileExists(absl::StrCat(folder, "/images", extension)))
      return true;
  }
  return false;
}

// The folder of component `number` below `folder`; `folder` itself if it has a model and `number` is 0. Empty: none.
std::string ColmapComponent(const std::string& folder, int number) {
  for (const char* parent : {"/", "/sparse/"}) {
    const std::string component = absl::StrCat(folder, parent, number);
    if (HasColmapFiles(component)) return component;
  }
  return number == 0 && HasColmapFiles(folder) ? folder : "";
}

}  // namespace

bool IsColmapBlock(const std::string& path) {
  if (!std::filesystem::is_directory(path)) return false;
  if (HasColmapFiles(path) || HasColmapFiles(path + "/sparse")) return true;
  for (int i = 0; i < 100; ++i) {  // as many as ReadColmapModel tries
    if (!ColmapComponent(path, i).empty()) return true;
  }
  return false;
}

ImportedBlock ReadColmapBlock(const std::string& path, const BlockReadOptions& options, Faults* faults,
                              Warnings* warnings) {
  ImportedBlock block;
  std::string folder = AbsolutePath(path);
  if (options.component >= 0) {
    const std::string component = ColmapComponent(folder, options.component);
    if (component.empty()) {
      faults->Add(InputError("--component", "", absl::StrCat(options.component),
                             absl::StrCat("the number of a folder with a model in ", folder, " or its folder sparse")));
      return block;
    }
    folder = component;
  }
  const CalibratedImages model =
      ReadColmapModel(folder, CalibrationContent::kCamerasAndPoints, faults, AllowedFiles::All(), warnings);
  for (const std::string& file : model.files) {
    block.files.push_back(absl::StrCat(folder, "/", file));
    const std::filesystem::path images = block.files.back();
    const std::string points = (images.parent_path() / ("points3D" + images.extension().string())).string();
    if (images.stem() == "images" && FileExists(points)) block.files.push_back(points);
  }
  if (!block.files.empty()) block.version = block.files[0].ends_with(".bin") ? "binary" : "text";
  std::map<uint32_t, int> cameras;
  for (const auto& [id, lens] : model.cameras) {
    cameras[id] = static_cast<int>(block.cameras.size());
    block.cameras.push_back({absl::StrCat("camera ", id), lens});
  }
  std::map<uint64_t, size_t> points;
  for (const TiePoint& point : model.points) {
    points[point.id] = block.points.size();
    block.points.push_back({point.position, {}});
  }
  size_t without_point = 0;
  for (const CalibratedImage& from : model.images) {
    const auto camera = cameras.find(from.camera_id);
    if (camera == cameras.end()) continue;  // a fault of ReadColmapModel
    BlockImage image;
    image.path = from.name;
    image.location = absl::StrCat("image ", from.id);
    image.camera = camera->second;
    image.rotation_cam_from_block = from.rotation_cam_from_world;
    image.centre = -from.rotation_cam_from_world.transpose() * from.translation_cam_from_world;
    const int index = static_cast<int>(block.images.size());
    std::set<uint64_t> seen;
    for (const ImageObservation& observation : from.observations) {
      const auto point = points.find(observation.point_id);
      if (point == points.end() || !seen.insert(observation.point_id).second) {
        ++without_point;
        continue;
      }
      block.points[point->second].observations.push_back({index, observation.position_px});
    }
    block.images.push_back(image);
  }
  if (without_point > 0) {
    block.left_out.push_back(
        absl::StrCat(without_point, " image points: the model has no point of their id, or they are a point's second"));
  }
  const size_t all_points = block.points.size();
  std::erase_if(block.points, [](const BlockTiePoint& point) { return point.observations.size() < 2; });
  if (block.points.size() < all_points) {
    block.left_out.push_back(absl::StrCat(all_points - block.points.size(), " points in fewer than two images"));
  }
  block.conventions = {
      "Quaternions and translations take the world to the camera; image coordinates count from the corner of the "
      "first pixel.",
      "The model names no reference system; distances are taken as metres."};
  return block;
}

}  // namespace tessera
