#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>

#include "common/storage/files.h"
#include "worker/city/moved_city.h"
#include "worker/tasks/task_functions.h"
#include "worker/tile/cut_tile.h"
#include "worker/tile/methods.h"

namespace tessera {

StatusOr<TaskOutcome> RunCut(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const CutParameters parameters, ParseCutParameters(request.parameters));
  control.Report(0, "reading the city");
  TESSERA_ASSIGN_OR_RETURN(const std::string survey_json, ReadFile(InputPath(request, kPlainSurveyFile)));
  TESSERA_ASSIGN_OR_RETURN(Survey survey, ParseSurvey(survey_json));
  if (parameters.borders) {
    TESSERA_ASSIGN_OR_RETURN(const std::string borders_json, ReadFile(InputPath(request, kBordersFile)));
    TESSERA_ASSIGN_OR_RETURN(survey.borders, ParseBorders(borders_json, survey.classes.size()));
  }
  TESSERA_ASSIGN_OR_RETURN(const CityReader city, CityReader::Open(InputPath(request, kCityFile)));
  TESSERA_RETURN_IF_ERROR(control.Check());
  control.Report(0.3, "cutting");
  std::optional<MovedCity> moved;
  if (!parameters.fine_iterations.empty()) {
    TESSERA_ASSIGN_OR_RETURN(moved, MovedCity::Open(InputPath(request, kMovedFile), city.vertex_ids_end(),
                                                    city.face_ids_end(), survey.cells.size()));
  }
  TESSERA_ASSIGN_OR_RETURN(const CutResult cut, CutTile(city, survey, parameters,
                                                        CutOptionsOf(parameters, survey.gsd_m, TileRefineOptions()),
                                                        moved ? &moved->spans() : nullptr));
  TESSERA_RETURN_IF_ERROR(control.Check());
  control.Report(0.9, "writing the tile");
  const TilePackage& package = cut.package;
  TESSERA_RETURN_IF_ERROR(WriteTilePackage(OutputPath(request, kTileFile), package));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(OutputPath(request, kReadsFile), ToJson(cut.reads)));
  const auto faces_in = [&](Region region) {
    return std::count_if(package.regions.begin(), package.regions.end(), [&](uint8_t r) { return r & region; });
  };
  TaskOutcome outcome;
  outcome.outputs = {kTileFile, kReadsFile};
  outcome.stats = nlohmann::json{{"faces", package.mesh.faces.size()},    {"core_faces", faces_in(kCoreRegion)},
                                 {"solve_faces", faces_in(kSolveRegion)}, {"repair_faces", faces_in(kRepairRegion)},
                                 {"label_faces", faces_in(kLabelRegion)}, {"views", package.views.size()},
                                 {"pairs", package.pairs.size()},         {"seconds", SecondsSince(clock, start_us)}}
                      .dump();
  return outcome;
}

}  // namespace tessera
