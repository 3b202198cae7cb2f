#include "server/plan/graph.h"

#include <algorithm>
#include <cmath>

#include "common/tile/survey.h"
#include "common/tile/task_parameters.h"
#include "server/plan/cell_index.h"
#include "server/plan/cost_model.h"
#include "server/plan/parts.h"
#include "server/plan/tiling.h"

namespace tessera {
namespace {

constexpr double kIngestSecondsPerFile = 0.1;  // before the survey tells more

struct PlannedTile {
  TileParameters parameters;
  TileWork work;
};

PlannedInput FromTask(const std::string& name, int task, const std::string& output) { return {name, "", task, output}; }

PlannedInput FromScene(const std::string& file) { return {std::string(kSceneFolder) + "/" + file, file, -1, ""}; }

StatusOr<std::vector<PlannedTile>> MakeTiles(const JobSettings& settings, const Survey& survey, double halo_m) {
  const CellIndex cells(survey);
  TESSERA_ASSIGN_OR_RETURN(const std::vector<CellRect> cores, LayOutTiles(cells, TilingOptionsOf(settings, halo_m)));
  std::vector<PlannedTile> tiles;
  for (const CellRect& core : cores) {
    PlannedTile tile;
    tile.parameters = {static_cast<int>(tiles.size()), core};
    tile.work = MeasureTile(cells, core, halo_m);
    tiles.push_back(std::move(tile));
  }
  return tiles;
}

std::string TileName(const char* kind, const PlannedTile& tile) {
  return std::string(kind) + " tile " + std::to_string(tile.parameters.tile);
}

}  // namespace

StatusOr<double> HaloOf(const JobSettings& settings, const Survey& survey) {
  TESSERA_RETURN_IF_ERROR(CheckJobSettings(settings));
  return HaloGsd(settings.method_settings) * survey.gsd_m;
}

StatusOr<PlannedTask> PlanIngest(const JobSettings& settings, const std::vector<std::string>& scene_files) {
  TESSERA_RETURN_IF_ERROR(CheckJobSettings(settings));
  if (scene_files.empty()) return absl::InvalidArgumentError("the scene has no files");
  PlannedTask task;
  task.kind = "ingest";
  task.name = "ingest";
  task.parameters =
      ToJson(IngestParameters{settings.method_settings.partners, settings.method_settings.views_per_direction});
  task.cost = kIngestSecondsPerFile * static_cast<double>(scene_files.size());
  for (const std::string& file : scene_files) task.inputs.push_back({file, file, -1, ""});
  return task;
}

StatusOr<std::vector<PlannedTask>> PlanTiles(const JobSettings& settings, const std::string& survey_json) {
  TESSERA_RETURN_IF_ERROR(CheckJobSettings(settings));
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(survey_json));
  const double halo_m = HaloGsd(settings.method_settings) * survey.gsd_m;
  const double blend_m = BlendGsd(settings.method_settings) * survey.gsd_m;
  TESSERA_ASSIGN_OR_RETURN(const std::vector<PlannedTile> tiles, MakeTiles(settings, survey, halo_m));
  const std::vector<StepRange> parts = PartsOf(settings, tiles.size());
  const std::vector<RefineEffort> efforts = EffortsOf(settings, parts);
  double reach_m = 0;
  for (const PlannedTile& tile : tiles) reach_m = std::max(reach_m, tile.work.reach_m);
  const int count = static_cast<int>(tiles.size());
  constexpr int kIngest = 0;
  const auto cut_task = [](int tile) { return 1 + tile; };
  const auto refine_task = [count](int tile, int part) { return 1 + (1 + part) * count + tile; };
  const int last_part = static_cast<int>(parts.size()) - 1;
  const auto stitch_task = [&](int tile) { return refine_task(tile, last_part + 1); };
  // Makes the results of `part` inputs of a task that uses what lies up to `near_m` from the tile: vertices there are
  // corners of faces that may lie a face's reach farther, and other tiles have a say up to the blend's width.
  const auto read_results = [&](const PlannedTile& tile, int part, double near_m, PlannedTask* task) {
    std::vector<TileParameters> read;
    for (const PlannedTile& other : tiles) {
      const double gap_m = DistanceBetween(tile.parameters.core, other.parameters.core, survey.ground.cell_m);
      if (gap_m > near_m + 2 * reach_m + blend_m) continue;
      const int id = other.parameters.tile;
      read.push_back(other.parameters);
      task->inputs.push_back(FromTask(TileInputName(id, kResultFile), refine_task(id, part), kResultFile));
    }
    return read;
  };

  std::vector<PlannedTask> tasks;
  for (const PlannedTile& tile : tiles) {
    const CutParameters parameters = {tile.parameters, halo_m, tile.work.views};
    const Prediction cost = PredictCut(survey, tile.work);
    tasks.push_back({"cut",
                     TileName("cut", tile),
                     tile.parameters.tile,
                     ToJson(parameters),
                     cost.core_seconds,
                     {FromTask(kCityFile, kIngest, kCityFile), FromTask(kSurveyFile, kIngest, kSurveyFile)},
                     cost.peak_bytes});
  }
  for (int part = 0; part <= last_part; ++part) {
    for (const PlannedTile& tile : tiles) {
      RefineParameters parameters = {settings.rounds,
                                     settings.method.empty() ? kMethods[0] : settings.method,
                                     settings.method_settings,
                                     parts[part].begin,
                                     parts[part].end,
                                     tile.parameters,
                                     blend_m,
                                     {}};
      const Prediction cost = PredictRefine(tile.work, efforts[part]);
      PlannedTask task = {"refine",
                          TileName("refine", tile) + (last_part > 0 ? " part " + std::to_string(part + 1) : ""),
                          tile.parameters.tile,
                          "",
                          cost.core_seconds,
                          {FromTask(kTileFile, cut_task(tile.parameters.tile), kTileFile)},
                          cost.peak_bytes};
      if (part > 0) {
        parameters.results = read_results(tile, part - 1, halo_m, &task);
        task.scene_inputs_of = refine_task(tile.parameters.tile, 0);
      }
      task.parameters = ToJson(parameters);
      for (const int32_t view : part == 0 ? tile.work.views : std::vector<int32_t>()) {
        task.inputs.push_back(FromScene(survey.views[view].image_path));
        if (!survey.views[view].likelihood_path.empty()) {
          task.inputs.push_back(FromScene(survey.views[view].likelihood_path));
        }
      }
      tasks.push_back(std::move(task));
    }
  }
  for (const PlannedTile& tile : tiles) {
    const int id = tile.parameters.tile;
    const Prediction cost = PredictStitch(tile.work);
    PlannedTask task = {"stitch",
                        TileName("stitch", tile),
                        id,
                        "",
                        cost.core_seconds,
                        {FromTask(kTileFile, cut_task(id), kTileFile)},
                        cost.peak_bytes};
    const StitchParameters parameters = {tile.parameters, blend_m, read_results(tile, last_part, 0, &task)};
    task.parameters = ToJson(parameters);
    tasks.push_back(std::move(task));
  }
  PublishParameters parameters;
  const Prediction cost = PredictPublish(survey);
  PlannedTask publish = {"publish",
                         "publish",
                         -1,
                         "",
                         cost.core_seconds,
                         {FromTask(kCityFile, kIngest, kCityFile), FromTask(kSurveyFile, kIngest, kSurveyFile)},
                         cost.peak_bytes};
  for (const PlannedTile& tile : tiles) {
    const int id = tile.parameters.tile;
    parameters.tiles.push_back(tile.parameters);
    publish.inputs.push_back(FromTask(TileInputName(id, kCoreFile), stitch_task(id), kCoreFile));
  }
  publish.parameters = ToJson(parameters);
  tasks.push_back(std::move(publish));
  return tasks;
}

}  // namespace tessera
