// The survey: the properties of a scene that ingest determines, and that planning and cutting use.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/border_trust.h"
#include "common/job/ground.h"
#include "common/scene/scene.h"

namespace tessera {

// A square of the ground and the faces whose centroid projects into it.
struct SurveyCell {
  int x = 0, y = 0;
  int64_t faces = 0;
  int64_t fine_faces = 0;  // predicted number after the second split (kSplitKind); 0: faces are not split again
  double reach_m = 0;  // largest distance of its faces' corners from the cell, in the ground plane
  // Bounding box of its faces, local frame.
  Eigen::Vector3d box_min = Eigen::Vector3d::Zero();
  Eigen::Vector3d box_max = Eigen::Vector3d::Zero();
  std::vector<int32_t> views;  // ascending indices of the views selected for it
};

// The changes of an update to the mesh of its base job.
struct MeshRevision {
  int64_t first_new_face = 0;             // faces with lower ids are those of the base job
  std::vector<std::array<int, 2>> cells;  // (x, y) of cells in which faces were removed or added, ascending
};

struct Survey {
  std::string scene_name;
  std::string mesh_path;  // relative to the scene's folder
  // Of the mesh, as in SceneDescription.
  std::optional<std::string> label_property;
  double gsd_m = 0;
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();  // local frame
  GroundPlane ground;
  std::vector<SurveyCell> cells;  // the cells with faces, by y, then x
  std::vector<SceneView> views;   // their indices are stable in the job and in jobs that continue it
  std::vector<Flight> flights;
  // Per view, smallest and largest depth in metres of the boxes of the cells that use it (FillViewDepths); 0, 0: no
  // cell uses it. An update only widens the intervals of its base, so that unchanged tiles keep their inputs.
  std::vector<std::array<double, 2>> view_depths;
  std::vector<std::array<int32_t, 2>> pairs;  // ordered pairs of views (reference, other) for the whole job
  std::vector<SceneClass> classes;
  bool has_likelihoods = false;
  // Identifies the classifier if the job computes the likelihoods (a trained model by its content), else empty. Then
  // borders.json holds the borders, and views have a likelihood_path in plain.json only.
  std::string classifier;
  BorderTrusts borders;  // of the likelihoods; an update keeps those of its base
  bool has_labels = false;
  Crs crs;
  // p_scene = rotationᵀ p_local + origin.
  Eigen::Vector3d origin_in_scene = Eigen::Vector3d::Zero();
  Eigen::Matrix3d rotation_local_from_scene = Eigen::Matrix3d::Identity();
  int64_t input_vertices = 0, input_faces = 0;  // of the scene's mesh file
  int64_t vertices = 0, faces = 0;              // after repair and splitting
  std::optional<MeshRevision> revision;         // only for updates with another mesh than their base
  std::string source;                           // of an imported scene (SceneSourceToJson); empty: none
  // How images, poses and start mesh fit (FitTableToJson), of the base job in an update. Empty: not measured.
  std::string fit;
  Warnings warnings;
  std::vector<std::pair<std::string, std::string>> skipped_images = {};  // name and reason (SceneDescription::skipped)
};

// Whether the mesh over the cell differs from that of the base job.
bool IsRevised(const Survey& survey, int x, int y);

// A view's likelihood_content if the job computes the likelihoods. `pixels`: hash of the photograph with its colours.
std::string ClassifiedContent(const Survey& survey, const std::string& pixels);

// Widens view_depths to the depths of the cells, and adds entries for new views.
void FillViewDepths(Survey* survey);

// The survey without names, dates and warnings, and with file paths replaced by ViewFileName: everything that may
// change without changing a result. Refinement tasks read this survey (plain.json).
Survey WithoutNames(Survey survey);

// Canonical JSON (sorted keys, no spaces): equal surveys give equal bytes.
std::string SurveyToJson(const Survey& survey);

// INVALID_ARGUMENT if `json` is not what SurveyToJson writes.
StatusOr<Survey> ParseSurvey(const std::string& json);

// The same for parts of the survey that tile packages also contain.
std::string ViewsToJson(const std::vector<SceneView>& views);
StatusOr<std::vector<SceneView>> ParseViews(const std::string& json);
std::string BordersToJson(const BorderTrusts& borders);
StatusOr<BorderTrusts> ParseBorders(const std::string& json, size_t classes);
std::string ClassesToJson(const std::vector<SceneClass>& classes);
StatusOr<std::vector<SceneClass>> ParseClasses(const std::string& json);

}  // namespace tessera
