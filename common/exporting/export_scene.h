// What exports need to know of a scene: its place, its ground grid and its classes.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/geodesy/frame.h"
#include "common/job/ground.h"
#include "common/job/survey.h"
#include "common/scene/scene.h"

namespace tessera {

struct ExportScene {
  Frame frame;                                    // between the scene's coordinates and the local frame
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();  // local frame, unit vector
  double gsd_m = 0;
  GroundPlane ground;
  std::vector<SceneClass> classes;
  std::optional<SceneSource> source;  // of an imported scene
};

// INVALID_ARGUMENT if Survey::source is damaged.
StatusOr<ExportScene> ExportSceneOf(const Survey& survey);

// Canonical JSON; report.json holds it as "frame", so that a result's folder can be exported.
std::string ExportSceneToJson(const ExportScene& scene);
// INVALID_ARGUMENT if `json` is not what ExportSceneToJson writes.
StatusOr<ExportScene> ParseExportScene(const std::string& json);

}  // namespace tessera
