#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "common/geometry/repair.h"
#include "common/scene/check.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "common/tile/survey.h"
#include "common/tile/task_parameters.h"
#include "worker/refine/density.h"
#include "worker/refine/pairs.h"
#include "worker/tasks/cell_views.h"
#include "worker/tasks/city_file.h"
#include "worker/tasks/stages.h"

namespace tessera {
namespace {

constexpr double kCellGsd = 64;  // rounded to a power of two in metres
constexpr int kMinPairSamples = 4000, kPairSamplesPerView = 100, kMaxPairSamples = 100000;

std::vector<PosedCamera> CamerasOf(const SceneDescription& scene) {
  std::vector<PosedCamera> cameras;
  for (const SceneView& view : scene.views) cameras.push_back(view.camera);
  return cameras;
}

// Labels as the line needs them: one a face, known or -1.
void CompleteLabels(const SceneDescription& scene, TriangleMesh* mesh) {
  if (mesh->labels.empty()) mesh->labels.assign(mesh->faces.size(), scene.has_likelihoods ? -1 : 0);
}

void FillPairs(const TriangleMesh& mesh, const std::vector<PosedCamera>& cameras, const IngestParameters& parameters,
               Survey* survey) {
  PairOptions options;
  options.partners = parameters.partners.value_or(options.partners);
  options.samples =
      std::clamp(kPairSamplesPerView * static_cast<int>(cameras.size()), kMinPairSamples, kMaxPairSamples);
  for (const ViewPair& pair : SelectPairs(mesh, cameras, options)) {
    survey->pairs.push_back({pair.reference, pair.other});
  }
}

}  // namespace

StatusOr<TaskOutcome> RunIngest(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const IngestParameters parameters, ParseIngestParameters(request.parameters));
  TaskOutcome outcome;
  control.Report(0, "checking the scene");
  // Says all that is wrong at once; after it loading cannot fail for the scene's sake.
  TESSERA_RETURN_IF_ERROR(CheckSceneFolder(request.input_dir, &outcome.warnings, PartOf(control, 0, 0.3)).status());
  Warnings said_already;
  TESSERA_ASSIGN_OR_RETURN(const SceneDescription scene, LoadScene(request.input_dir, &said_already));
  TESSERA_ASSIGN_OR_RETURN(TriangleMesh input, LoadSceneMesh(scene, 0));
  Survey survey;
  TESSERA_ASSIGN_OR_RETURN(survey.gsd_m, MedianGsd(scene, input));
  TESSERA_RETURN_IF_ERROR(control.Check());

  control.Report(0.3, "repairing the mesh");
  TESSERA_ASSIGN_OR_RETURN(const RepairedMesh repaired, RepairMesh(input, &said_already));
  TESSERA_RETURN_IF_ERROR(control.Check());

  control.Report(0.5, "splitting faces");
  const std::vector<PosedCamera> cameras = CamerasOf(scene);
  SplitMesh split = SplitLargeFaces(repaired.mesh, cameras, DensityOptions());
  City city;
  city.mesh = std::move(split.mesh);
  CompleteLabels(scene, &city.mesh);
  city.input_face.reserve(split.parent_face.size());
  for (const uint32_t parent : split.parent_face) city.input_face.push_back(repaired.face_in_input[parent]);
  TESSERA_RETURN_IF_ERROR(control.Check());

  CellViewOptions view_options;
  view_options.choice.views_per_direction =
      parameters.views_per_direction.value_or(view_options.choice.views_per_direction);
  survey.scene_name = scene.name;
  survey.up = scene.up_in_local;
  survey.ground = MakeGroundPlane(survey.up, std::exp2(std::round(std::log2(kCellGsd * survey.gsd_m))));
  survey.views = scene.views;
  survey.classes = scene.classes;
  survey.has_likelihoods = scene.has_likelihoods;
  survey.has_labels = !input.labels.empty();
  survey.origin_in_scene = scene.frame.origin_in_scene();
  survey.rotation_local_from_scene = scene.frame.rotation_local_from_scene();
  survey.input_vertices = static_cast<int64_t>(input.vertices.size());
  survey.input_faces = static_cast<int64_t>(input.faces.size());
  survey.vertices = static_cast<int64_t>(city.mesh.vertices.size());
  survey.faces = static_cast<int64_t>(city.mesh.faces.size());
  TESSERA_RETURN_IF_ERROR(FillCells(city.mesh, view_options, PartOf(control, 0.6, 0.9), &survey));
  FillPairs(city.mesh, cameras, parameters, &survey);
  survey.warnings = outcome.warnings;

  control.Report(0.9, "writing the city");
  TESSERA_RETURN_IF_ERROR(WriteCity(OutputPath(request, kCityFile), city));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(OutputPath(request, kSurveyFile), SurveyToJson(survey)));
  outcome.outputs = {kCityFile, kSurveyFile};
  outcome.stats = nlohmann::json{{"views", survey.views.size()},
                                 {"pairs", survey.pairs.size()},
                                 {"cells", survey.cells.size()},
                                 {"input_faces", survey.input_faces},
                                 {"faces", survey.faces},
                                 {"gsd_m", survey.gsd_m},
                                 {"seconds", SecondsSince(clock, start_us)}}
                      .dump();
  return outcome;
}

}  // namespace tessera
