#include <nlohmann/json.hpp>

#include "common/meshio/ply.h"
#include "common/storage/files.h"
#include "common/tile/survey.h"
#include "common/tile/task_parameters.h"
#include "worker/tasks/merge_cores.h"
#include "worker/tasks/report.h"
#include "worker/tasks/stages.h"

namespace tessera {

StatusOr<TaskOutcome> RunPublish(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const PublishParameters parameters, ParsePublishParameters(request.parameters));
  control.Report(0, "reading the city");
  TESSERA_ASSIGN_OR_RETURN(const std::string survey_json, ReadFile(InputPath(request, kSurveyFile)));
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(survey_json));
  TESSERA_ASSIGN_OR_RETURN(const City city, ReadCity(InputPath(request, kCityFile)));

  CoreMerger merger(city);
  std::vector<ReportedTile> tiles;
  for (const TileParameters& tile : parameters.tiles) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    TESSERA_ASSIGN_OR_RETURN(const TileCore core,
                             ReadTileCore(InputPath(request, TileInputName(tile.tile, kCoreFile))));
    TESSERA_RETURN_IF_ERROR(merger.Add(core));
    tiles.push_back({core.tile, core.report});
    control.Report(0.2 + 0.5 * static_cast<double>(tiles.size()) / parameters.tiles.size(), "merging");
  }
  TESSERA_RETURN_IF_ERROR(merger.Finish());

  control.Report(0.7, "writing the mesh");
  TESSERA_RETURN_IF_ERROR(
      WriteFileAtomic(OutputPath(request, kReportFile), MakeReport(survey, city.mesh, merger.mesh(), tiles)));
  TriangleMesh result = merger.mesh();
  for (Eigen::Vector3d& p : result.vertices) {
    p = survey.rotation_local_from_scene.transpose() * p + survey.origin_in_scene;
  }
  PlyWriteOptions options;
  for (const SceneClass& c : survey.classes) options.label_colors_rgb.push_back(c.color_rgb);
  options.face_confidence = merger.confidence();
  options.input_face = city.input_face;
  TESSERA_RETURN_IF_ERROR(WritePly(OutputPath(request, kMeshFile), result, options));

  TaskOutcome outcome;
  outcome.outputs = {kMeshFile, kReportFile};
  outcome.stats = nlohmann::json{{"faces", result.faces.size()}, {"seconds", SecondsSince(clock, start_us)}}.dump();
  return outcome;
}

}  // namespace tessera
