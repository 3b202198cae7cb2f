#include <nlohmann/json.hpp>

#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "common/tile/change_cells.h"
#include "common/tile/survey.h"
#include "common/tile/task_parameters.h"
#include "worker/changes/change_report.h"
#include "worker/changes/surface_raster.h"
#include "worker/tasks/change_files.h"
#include "worker/tasks/refined_surface.h"
#include "worker/tasks/stages.h"

namespace tessera {

StatusOr<TaskOutcome> RunChanges(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const ChangesParameters parameters, ParseChangesParameters(request.parameters));
  TESSERA_ASSIGN_OR_RETURN(const std::string survey_json, ReadFile(InputPath(request, kPlainSurveyFile)));
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(survey_json));
  TESSERA_ASSIGN_OR_RETURN(const CityReader city, CityReader::Open(InputPath(request, kCityFile)));
  GroundPlane ground = survey.ground;
  ground.cell_m = ChangeCellSize_m(survey.gsd_m);
  std::vector<ChangeRaster> rasters;
  std::vector<SurfaceRaster> refined;
  for (const CellRect& block : parameters.blocks) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(static_cast<double>(rasters.size()) / static_cast<double>(parameters.blocks.size()),
                   "comparing the result");
    TESSERA_ASSIGN_OR_RETURN(ChangeRaster raster, ReadChangeRaster(InputPath(request, ChangeBlockFile(block))));
    TESSERA_ASSIGN_OR_RETURN(const TriangleMesh surface,
                             RefinedSurface(request, city, ground, PlanOf(block, ground.cell_m, 1), parameters.states));
    refined.push_back(surface.faces.empty() ? SurfaceRaster(block, ground.cell_m)
                                            : DrawSurface(TopSurface(surface, ground), ground, block));
    rasters.push_back(std::move(raster));
  }
  const std::vector<ChangeArea> areas =
      FindChangeAreas(rasters, refined, ClassRoles(survey.classes), survey.gsd_m, ChangeAreaOptions());
  SceneDescription scene;
  scene.name = parameters.scene_name;
  scene.classes = survey.classes;
  scene.up_in_local = survey.up;
  scene.frame = Frame::Of(survey.crs, survey.origin_in_scene, survey.rotation_local_from_scene);
  const ChangeRaster whole = MergeRasters(rasters);
  TESSERA_RETURN_IF_ERROR(WriteChangeReport({scene, ground, whole, areas, survey.gsd_m}, request.output_dir));
  TaskOutcome outcome;
  outcome.outputs = {"changes.json", "changes.geojson", "changes.png"};
  int64_t unfollowed = 0;
  for (const ChangeArea& area : areas) unfollowed += area.followed && !*area.followed;
  if (unfollowed > 0) {
    outcome.warnings.push_back(std::to_string(unfollowed) + " of " + std::to_string(areas.size()) +
                               " changed areas need a new coarse mesh, for the old one cannot follow them: "
                               "changes.json has them (followed: false)");
  }
  outcome.stats =
      nlohmann::json{{"areas", areas.size()}, {"unfollowed", unfollowed}, {"seconds", SecondsSince(clock, start_us)}}
          .dump();
  return outcome;
}

}  // namespace tessera
