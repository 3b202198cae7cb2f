#include <nlohmann/json.hpp>
#include <numeric>

#include "common/storage/files.h"
#include "worker/tasks/cut_tile.h"
#include "worker/tasks/stages.h"

namespace tessera {

StatusOr<TaskOutcome> RunCut(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const CutParameters parameters, ParseCutParameters(request.parameters));
  control.Report(0, "reading the city");
  TESSERA_ASSIGN_OR_RETURN(const std::string survey_json, ReadFile(InputPath(request, kSurveyFile)));
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(survey_json));
  TESSERA_ASSIGN_OR_RETURN(const CityReader city, CityReader::Open(InputPath(request, kCityFile)));
  TESSERA_RETURN_IF_ERROR(control.Check());
  control.Report(0.3, "cutting");
  TESSERA_ASSIGN_OR_RETURN(const TilePackage package, CutTile(city, survey, parameters));
  TESSERA_RETURN_IF_ERROR(control.Check());
  control.Report(0.9, "writing the tile");
  TESSERA_RETURN_IF_ERROR(WriteTilePackage(OutputPath(request, kTileFile), package));
  TaskOutcome outcome;
  outcome.outputs = {kTileFile};
  outcome.stats = nlohmann::json{{"faces", package.mesh.faces.size()},
                                 {"core_faces", std::accumulate(package.core.begin(), package.core.end(), int64_t{0})},
                                 {"occluder_faces", package.occluders.faces.size()},
                                 {"views", package.views.size()},
                                 {"pairs", package.pairs.size()},
                                 {"seconds", SecondsSince(clock, start_us)}}
                      .dump();
  return outcome;
}

}  // namespace tessera
