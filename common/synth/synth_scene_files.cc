#include "common/synth/synth_scene_files.h"

#include <Eigen/Geometry>
#include <array>
#include <nlohmann/json.hpp>

#include "absl/strings/str_format.h"
#include "common/storage/files.h"

namespace tessera {
Status WriteColmapText(const std::string& folder, const std::vector<SynthView>& flight, const std::string& extension,
                       const std::vector<SparsePoint>& points, const ColmapText* earlier) {
  const int first_image = 1 + (earlier == nullptr ? 0 : earlier->image_count);
  const size_t first_point = 1 + (earlier == nullptr ? 0 : static_cast<size_t>(earlier->point_count));
  std::string cameras = "# Camera list: CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n";
  for (int direction = 0; direction < kDirections; ++direction) {
    for (const SynthView& view : flight) {
      if (view.direction != direction) continue;
      const PinholeCamera& c = view.camera.intrinsics;
      absl::StrAppendFormat(&cameras, "%d PINHOLE %d %d %.17g %.17g %.17g %.17g\n", direction + 1, c.width, c.height,
                            c.fx, c.fy, c.cx, c.cy);
      break;
    }
  }
  if (earlier != nullptr) cameras = earlier->cameras;
  // The index of each observation in its image's list.
  std::vector<std::vector<std::pair<const SparsePoint::Observation*, size_t>>> seen(flight.size());
  std::string text = "# 3D point list: POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n";
  if (earlier != nullptr) text = earlier->points;
  for (size_t k = 0; k < points.size(); ++k) {
    const SparsePoint& p = points[k];
    absl::StrAppendFormat(&text, "%zu %.12g %.12g %.12g %d %d %d %.4f", k + first_point, p.position.x(), p.position.y(),
                          p.position.z(), p.color_rgb[0], p.color_rgb[1], p.color_rgb[2], p.error_px);
    for (const auto& observation : p.track) {
      absl::StrAppendFormat(&text, " %d %zu", observation.view + first_image, seen[observation.view].size());
      seen[observation.view].push_back({&observation, k + first_point});
    }
    text += '\n';
  }
  std::string images =
      "# Image list, two lines each: IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME and "
      "POINTS2D[] as (X, Y, POINT3D_ID)\n";
  if (earlier != nullptr) images = earlier->images;
  for (size_t k = 0; k < flight.size(); ++k) {
    const Eigen::Quaterniond q(flight[k].camera.rotation_cam_from_world);
    const Eigen::Vector3d& t = flight[k].camera.translation_cam_from_world;
    absl::StrAppendFormat(&images, "%zu %.17g %.17g %.17g %.17g %.17g %.17g %.17g %d %s%s\n", k + first_image, q.w(),
                          q.x(), q.y(), q.z(), t.x(), t.y(), t.z(), flight[k].direction + 1, flight[k].stem, extension);
    for (size_t n = 0; n < seen[k].size(); ++n) {
      absl::StrAppendFormat(&images, "%s%.4f %.4f %zu", n ? " " : "", seen[k][n].first->x_px, seen[k][n].first->y_px,
                            seen[k][n].second);
    }
    images += '\n';
  }
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(folder + "/cameras.txt", cameras));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(folder + "/images.txt", images));
  return WriteFileAtomic(folder + "/points3D.txt", text);
}

Status WriteSceneJson(const std::string& folder, const std::string& name, const SynthOptions& options,
                      const SynthReport& report, const EpochFiles* epoch) {
  const bool with_mesh = epoch == nullptr || epoch->options.whole || epoch->options.new_mesh;
  nlohmann::ordered_json synth;
  synth["parameters"] = {{"blocks", {options.columns, options.rows}},
                         {"seed", options.seed},
                         {"gsd_m", options.gsd_m},
                         {"image_size_px", {options.image_width_px, options.image_height_px}},
                         {"images", options.with_images}};
  synth["made"] = {{"images", report.images},
                   {"sparse_points", report.sparse_points},
                   {"truth_faces", report.truth_faces},
                   {"start_faces", report.start_faces},
                   {"area_m2", report.area_m2}};
  if (epoch != nullptr) {
    std::array<int, kChangeKinds.size()> counts{};
    for (const CityChange& change : epoch->changes) ++counts[static_cast<int>(change.kind)];
    nlohmann::ordered_json of_kind;
    for (const ChangeKind kind : kChangeKinds) of_kind[ChangeKindName(kind)] = counts[static_cast<size_t>(kind)];
    synth["change"] = {{"seed", epoch->options.seed},
                       {"part", epoch->options.part},
                       {"whole", epoch->options.whole || epoch->options.new_mesh},
                       {"new_mesh", epoch->options.new_mesh},
                       {"changes", of_kind}};
  }
  nlohmann::ordered_json difficulty = {{"voxel_m", report.voxel_m}, {"voxel_gsd", report.voxel_m / report.gsd_m}};
  if (with_mesh) difficulty["start_average_accuracy_by_area"] = report.start_accuracy_by_area;
  if (options.with_images) {
    if (with_mesh) difficulty["start_average_accuracy_by_pixels"] = report.start_accuracy_by_pixels;
    difficulty["likelihood_argmax_accuracy"] = report.likelihood_accuracy;
  }
  synth["difficulty"] = difficulty;
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(folder + "/synth.json", synth.dump(2) + "\n"));
  nlohmann::ordered_json scene;
  scene["tessera_scene"] = 1;
  scene["name"] = name;
  scene["cameras"] = "colmap";
  if (options.with_images) {
    scene["images"] = "images";
    scene["likelihoods"] = "likelihoods";
  }
  if (with_mesh) scene["mesh"] = "mesh.ply";
  scene["classes"] = {"ground", "facade", "roof", "vegetation"};
  scene["crs"] = {{"type", "local"}};
  scene["up"] = {0, 0, 1};
  const nlohmann::ordered_json first = {{"name", "spring"}, {"date", "2026-05-14"}, {"images", {"*"}}};
  nlohmann::ordered_json later = {{"name", kLaterFlight}, {"date", "2027-05-14"}, {"images", {"*"}}};
  scene["flights"] = nlohmann::ordered_json::array();
  if (epoch == nullptr) {
    scene["flights"].push_back(first);
  } else {
    // An image belongs to the first flight with a matching pattern.
    if (with_mesh) later["images"] = {std::string(kLaterFlight) + "_*"};
    scene["flights"].push_back(later);
    if (with_mesh) scene["flights"].push_back(first);
  }
  return WriteFileAtomic(folder + "/scene.json", scene.dump(2) + "\n");
}

}  // namespace tessera
