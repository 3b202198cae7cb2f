#include <nlohmann/json.hpp>

#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "worker/city/collected_faces.h"
#include "worker/tasks/task_functions.h"
#include "worker/tile/repair_tile.h"
#include "worker/tile/tile_files.h"

namespace tessera {

StatusOr<TaskOutcome> RunStart(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const StartParameters parameters, ParseStartParameters(request.parameters));
  TESSERA_ASSIGN_OR_RETURN(const std::string survey_json, ReadFile(InputPath(request, kPlainSurveyFile)));
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(survey_json));
  TESSERA_ASSIGN_OR_RETURN(const CityReader city, CityReader::Open(InputPath(request, kCityFile)));
  TESSERA_ASSIGN_OR_RETURN(CollectedFaces faces, CollectCells(city, survey.ground, parameters.tile.core, control));
  TileState state;
  state.tile = parameters.tile.tile;
  state.vertex_ids = std::move(faces.vertex_ids);
  state.positions = std::move(faces.mesh.vertices);
  state.face_ids = std::move(faces.face_ids);
  state.labels = std::move(faces.mesh.labels);
  const int classes = static_cast<int>(survey.classes.size());
  for (const int32_t label : state.labels) state.confidence.push_back(CarriedConfidence(classes, label));
  TESSERA_RETURN_IF_ERROR(WriteTileState(OutputPath(request, kStateFile), state));
  TaskOutcome outcome;
  outcome.outputs = {kStateFile};
  outcome.stats = nlohmann::json{{"faces", state.face_ids.size()}, {"seconds", SecondsSince(clock, start_us)}}.dump();
  return outcome;
}

}  // namespace tessera
