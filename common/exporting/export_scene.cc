#include "common/exporting/export_scene.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "common/base/json_bounds.h"
#include "common/job/exact_numbers.h"
#include "common/scene/scene_json.h"

namespace tessera {
namespace {

using SceneObject = nlohmann::basic_json<std::map, std::vector, std::string, bool, int64_t, uint64_t, double,
                                         std::allocator, ExactNumbers<nlohmann::adl_serializer>::Serializer>;

constexpr const char* kFrameName = "report.json: frame";

std::vector<double> Numbers(const Eigen::MatrixXd& matrix) {  // row by row
  std::vector<double> numbers;
  for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) numbers.push_back(matrix(r, c));
  }
  return numbers;
}

Eigen::Vector3d VectorOf(const SceneObject& json) {
  return {json.at(0).get<double>(), json.at(1).get<double>(), json.at(2).get<double>()};
}

Eigen::Matrix3d MatrixOf(const SceneObject& json) {
  Eigen::Matrix3d matrix;
  for (int k = 0; k < 9; ++k) matrix(k / 3, k % 3) = json.at(k).get<double>();
  return matrix;
}

// The values of `crs` and `source`, which are written as in scene.json.
StatusOr<SceneFile> ParsePlace(const SceneObject& json) {
  SceneObject place = {{"tessera_scene", 1}, {"crs", json.at("crs")}};
  if (json.contains("source")) place["source"] = json.at("source");
  Faults faults;
  SceneFile file = ParseSceneFile(place.dump(), kFrameName, &faults);
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return file;
}

}  // namespace

StatusOr<ExportScene> ExportSceneOf(const Survey& survey) {
  ExportScene scene;
  scene.frame = Frame::Of(survey.crs, survey.origin_in_scene, survey.rotation_local_from_scene);
  scene.up = survey.up;
  scene.gsd_m = survey.gsd_m;
  scene.ground = survey.ground;
  scene.classes = survey.classes;
  if (survey.source.empty()) return scene;
  SceneObject json = {{"crs", SceneObject::parse(CrsToJson(survey.crs))}};
  json["source"] = SceneObject::parse(survey.source, nullptr, /*allow_exceptions=*/false);
  TESSERA_ASSIGN_OR_RETURN(SceneFile file, ParsePlace(json));
  scene.source = std::move(file.source);
  return scene;
}

std::string ExportSceneToJson(const ExportScene& scene) {
  SceneObject classes = SceneObject::array();
  for (const SceneClass& c : scene.classes) classes.push_back({{"name", c.name}, {"color", c.color_rgb}});
  SceneObject json = {{"crs", SceneObject::parse(CrsToJson(scene.frame.crs()))},
                      {"origin_in_scene", Numbers(scene.frame.origin_in_scene())},
                      {"rotation_local_from_scene", Numbers(scene.frame.rotation_local_from_scene())},
                      {"up", Numbers(scene.up)},
                      {"gsd_m", scene.gsd_m},
                      {"cell_m", scene.ground.cell_m},
                      {"classes", classes}};
  if (scene.source) json["source"] = SceneObject::parse(SceneSourceToJson(*scene.source));
  return json.dump(-1, ' ', false, SceneObject::error_handler_t::replace);
}

StatusOr<ExportScene> ParseExportScene(const std::string& json) {
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth(kFrameName, json));
  try {
    const SceneObject in = SceneObject::parse(json);
    TESSERA_ASSIGN_OR_RETURN(SceneFile place, ParsePlace(in));
    ExportScene scene;
    scene.frame =
        Frame::Of(place.crs, VectorOf(in.at("origin_in_scene")), MatrixOf(in.at("rotation_local_from_scene")));
    scene.up = VectorOf(in.at("up"));
    scene.gsd_m = in.at("gsd_m");
    scene.ground = MakeGroundPlane(scene.up, in.at("cell_m"));
    scene.source = std::move(place.source);
    for (const SceneObject& c : in.at("classes")) {
      SceneClass& out = scene.classes.emplace_back();
      out.name = c.at("name");
      out.color_rgb = c.at("color").get<std::array<uint8_t, 3>>();
    }
    if (!(scene.gsd_m > 0) || !(scene.ground.cell_m > 0) || !(std::abs(scene.up.norm() - 1) < 1e-6)) {
      return absl::InvalidArgumentError(std::string(kFrameName) +
                                        ": expected a positive gsd_m and cell_m, and a unit vector `up`");
    }
    return scene;
  } catch (const SceneObject::exception& error) {
    return absl::InvalidArgumentError(std::string(kFrameName) + ": " + error.what());
  }
}

}  // namespace tessera
