#include <nlohmann/json.hpp>

#include "absl/strings/str_format.h"
#include "common/job/change_cells.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "worker/changes/change_report.h"
#include "worker/changes/surface_raster.h"
#include "worker/publish/outdated_faces.h"
#include "worker/tasks/refined_surface.h"
#include "worker/tasks/task_functions.h"

namespace tessera {

StatusOr<TaskOutcome> RunChanges(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const ChangesParameters parameters, ParseChangesParameters(request.parameters));
  TESSERA_ASSIGN_OR_RETURN(const std::string survey_json, ReadFile(InputPath(request, kPlainSurveyFile)));
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(survey_json));
  TESSERA_ASSIGN_OR_RETURN(const CityReader city, CityReader::Open(InputPath(request, kCityFile)));
  GroundPlane ground = survey.ground;
  ground.cell_m = ChangeCellSize_m(survey.gsd_m);
  TESSERA_ASSIGN_OR_RETURN(const StatesOfTiles states, OpenStates(request, parameters.states));
  OutdatedFaces of_base;
  if (parameters.outdated) {
    TESSERA_ASSIGN_OR_RETURN(of_base, OutdatedFaces::Open(InputPath(request, kOutdatedFile)));
  }
  std::vector<ChangeRaster> rasters;
  std::vector<SurfaceRaster> refined;
  for (const CellRect& block : parameters.blocks) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(0.7 * static_cast<double>(rasters.size()) / static_cast<double>(parameters.blocks.size()),
                   "comparing the refined mesh");
    TESSERA_ASSIGN_OR_RETURN(ChangeRaster raster, ReadChangeRaster(InputPath(request, ChangeBlockFile(block))));
    TESSERA_ASSIGN_OR_RETURN(const CollectedFaces surface,
                             RefinedSurface(city, ground, PlanOf(block, ground.cell_m, 1), states));
    refined.push_back(surface.face_ids.empty() ? SurfaceRaster(block, ground.cell_m)
                                               : DrawSurface(TopSurface(surface.mesh, ground), ground, block));
    rasters.push_back(std::move(raster));
  }
  const std::vector<ClassRole> roles = ClassRoles(survey.classes);
  const ChangeAreaOptions options;
  std::vector<ChangeArea> areas = FindChangeAreas(rasters, refined, roles, survey.gsd_m, options);
  const ChangeRaster whole = MergeRasters(rasters);
  const EpochDisagreement disagreement = MeasureDisagreement(whole, refined, roles, survey.gsd_m, options);
  OutdatedFaceFinder outdated(ground, whole, of_base.ids(), &areas);
  control.Report(0.7, "finding changes that the mesh does not follow");
  for (const CellRect& block : parameters.blocks) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    if (!outdated.Asks(block)) continue;
    // Vertices have moved since the city's blocks were written, so the blocks' boxes are enlarged.
    TESSERA_ASSIGN_OR_RETURN(const CollectedFaces surface,
                             RefinedSurface(city, ground, PlanOf(block, ground.cell_m, kBlockMargin), states));
    outdated.Add(surface, block);
  }
  TESSERA_RETURN_IF_ERROR(WriteOutdatedFaces(OutputPath(request, kOutdatedFile), std::move(outdated).Finish()));
  SceneDescription scene;
  scene.name = parameters.scene_name;
  scene.classes = survey.classes;
  scene.up_in_local = survey.up;
  scene.frame = Frame::Of(survey.crs, survey.origin_in_scene, survey.rotation_local_from_scene);
  TESSERA_RETURN_IF_ERROR(
      WriteChangeReport({scene, ground, whole, areas, survey.gsd_m, disagreement}, request.output_dir));
  TaskOutcome outcome;
  outcome.outputs = {"changes.json", kChangesGeoJsonFile, "changes.png", kOutdatedFile};
  int64_t unfollowed = 0;
  for (const ChangeArea& area : areas) unfollowed += area.followed && !*area.followed;
  if (unfollowed > 0) {
    outcome.warnings.push_back(std::to_string(unfollowed) + " of " + std::to_string(areas.size()) +
                               " changed areas need a new coarse mesh: refinement of the old one cannot follow them; "
                               "changes.json lists them (followed: false)");
  }
  if (disagreement.IsLarge()) {
    outcome.warnings.push_back(absl::StrFormat(
        "the new images differ from the base job's surface: heights on %.0f %% of the measured ground, classes on "
        "%.0f %%, ZNCC %.2f on the old and %.2f on the new surface; where much was rebuilt, use a new coarse mesh",
        100 * disagreement.before.heights, 100 * disagreement.before.labels, disagreement.agreement_before,
        disagreement.agreement));
  }
  outcome.stats =
      nlohmann::json{{"areas", areas.size()}, {"unfollowed", unfollowed}, {"seconds", SecondsSince(clock, start_us)}}
          .dump();
  return outcome;
}

}  // namespace tessera
