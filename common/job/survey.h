// What ingest finds out about a scene, and all that planning and cutting need to know of it.
#ifndef TESSERA_COMMON_JOB_SURVEY_H_
#define TESSERA_COMMON_JOB_SURVEY_H_

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/border_trust.h"
#include "common/job/ground.h"
#include "common/scene/scene.h"

namespace tessera {

// A square of the ground and the faces whose centroid lies over it.
struct SurveyCell {
  int x = 0, y = 0;
  int64_t faces = 0;
  double reach_m = 0;  // how far corners of its faces lie outside the cell, in the ground plane
  // Everything of its faces lies in this box, local frame.
  Eigen::Vector3d box_min = Eigen::Vector3d::Zero();
  Eigen::Vector3d box_max = Eigen::Vector3d::Zero();
  std::vector<int32_t> views;  // indices of the views chosen for it, ascending
};

// What an update did to its base's mesh.
struct MeshRevision {
  int64_t first_new_face = 0;             // faces with lower ids are the base's
  std::vector<std::array<int, 2>> cells;  // (x, y) of those that lost a face or got one, ascending
};

struct Survey {
  std::string scene_name;
  std::string mesh_path;  // relative to the scene
  double gsd_m = 0;
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();  // local frame
  GroundPlane ground;
  std::vector<SurveyCell> cells;  // those that have faces, by y, then x
  std::vector<SceneView> views;   // their numbers are the job's, and those of jobs that go on from it
  std::vector<Flight> flights;
  // Of each view, nearest and farthest depth of the boxes of the cells that chose it, metres (FillViewDepths); 0, 0:
  // none did. An update only widens those of its base, so that they stay where nothing else changes.
  std::vector<std::array<double, 2>> view_depths;
  std::vector<std::array<int32_t, 2>> pairs;  // ordered pairs of views (reference, other) for the whole job
  std::vector<SceneClass> classes;
  bool has_likelihoods = false;
  // Where the job makes the likelihoods itself: what tells its classifier from others (a trained one by its content).
  // Their borders are then known from borders.json alone, and views have no likelihood_path but in plain.json.
  std::string classifier;
  BorderTrusts borders;  // of the likelihoods; an update keeps its base's
  bool has_labels = false;
  Crs crs;
  // p_scene = rotationᵀ p_local + origin.
  Eigen::Vector3d origin_in_scene = Eigen::Vector3d::Zero();
  Eigen::Matrix3d rotation_local_from_scene = Eigen::Matrix3d::Identity();
  int64_t input_vertices = 0, input_faces = 0;  // as in the scene's file
  int64_t vertices = 0, faces = 0;              // after repair and splitting
  std::optional<MeshRevision> revision;         // of an update whose mesh is not its base's
  Warnings warnings;
};

// Whether the mesh over the cell is not the base's.
bool IsRevised(const Survey& survey, int x, int y);

// A view's likelihood_content where the job makes the likelihoods: `pixels` tells the photograph, with its colours.
std::string ClassifiedContent(const Survey& survey, const std::string& pixels);

// Makes view_depths hold what the cells ask for: those that are there are widened, new ones added.
void FillViewDepths(Survey* survey);

// The same without names, paths, dates and warnings (of files, those of ViewFileName): what may be called otherwise
// without any result changing. Tasks of the line read this.
Survey WithoutNames(Survey survey);

// Canonical JSON (sorted keys, no spaces): equal surveys are equal bytes.
std::string SurveyToJson(const Survey& survey);

// INVALID_ARGUMENT if `json` is not what SurveyToJson writes.
StatusOr<Survey> ParseSurvey(const std::string& json);

// The same for parts, which tile packages hold too.
std::string ViewsToJson(const std::vector<SceneView>& views);
StatusOr<std::vector<SceneView>> ParseViews(const std::string& json);
std::string BordersToJson(const BorderTrusts& borders);
StatusOr<BorderTrusts> ParseBorders(const std::string& json, size_t classes);
std::string ClassesToJson(const std::vector<SceneClass>& classes);
StatusOr<std::vector<SceneClass>> ParseClasses(const std::string& json);

}  // namespace tessera

#endif  // TESSERA_COMMON_JOB_SURVEY_H_
