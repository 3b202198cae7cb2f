#include "server/plan/graph.h"

#include <algorithm>
#include <cmath>
#include <numeric>

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

// Where the views' images and likelihoods are in the scene's list of files.
StatusOr<std::vector<std::vector<int>>> FilesOfViews(const Survey& survey, const std::vector<std::string>& files) {
  std::vector<std::vector<int>> found(survey.views.size());
  for (size_t v = 0; v < survey.views.size(); ++v) {
    for (const std::string* path : {&survey.views[v].image_path, &survey.views[v].likelihood_path}) {
      if (path->empty()) continue;
      const auto it = std::lower_bound(files.begin(), files.end(), *path);
      if (it == files.end() || *it != *path) return absl::NotFoundError("the scene has no file " + *path);
      found[v].push_back(static_cast<int>(it - files.begin()));
    }
  }
  return found;
}

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
  task.scene_files.resize(scene_files.size());
  std::iota(task.scene_files.begin(), task.scene_files.end(), 0);
  return task;
}

StatusOr<std::vector<PlannedTask>> PlanTiles(const JobSettings& settings, const std::string& survey_json,
                                             const std::vector<std::string>& scene_files) {
  TESSERA_RETURN_IF_ERROR(CheckJobSettings(settings));
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(survey_json));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<std::vector<int>> files_of_view, FilesOfViews(survey, scene_files));
  const double halo_m = HaloGsd(settings.method_settings) * survey.gsd_m;
  const double blend_m = BlendGsd(settings.method_settings) * survey.gsd_m;
  TESSERA_ASSIGN_OR_RETURN(const std::vector<PlannedTile> tiles, MakeTiles(settings, survey, halo_m));
  const std::vector<StepRange> parts = PartsOf(settings, tiles.size());
  const std::vector<RefineEffort> efforts = EffortsOf(settings, parts);
  const int count = static_cast<int>(tiles.size());
  constexpr int kIngest = 0;
  const auto cut_task = [](int tile) { return 1 + tile; };
  const auto crop_task = [count](int tile) { return 1 + count + tile; };
  const auto refine_task = [count](int tile, int part) { return 1 + (2 + part) * count + tile; };
  const int last_part = static_cast<int>(parts.size()) - 1;
  const auto stitch_task = [&](int tile) { return refine_task(tile, last_part + 1); };
  // Makes the results of `part` inputs of a task that uses what lies up to `near_m` from the tile. Vertices there are
  // corners of faces that may lie a face's reach farther: of the cores that near, not of the city, where one face of a
  // huge triangle would make every tile read every other. And other tiles have a say up to the blend's width.
  const auto read_results = [&](const PlannedTile& tile, int part, double near_m, PlannedTask* task) {
    const auto gap_m = [&](const PlannedTile& other) {
      return DistanceBetween(tile.parameters.core, other.parameters.core, survey.ground.cell_m);
    };
    double reach_m = 0;
    for (const PlannedTile& other : tiles) {
      if (gap_m(other) <= near_m) reach_m = std::max(reach_m, other.work.reach_m);
    }
    std::vector<TileParameters> read;
    for (const PlannedTile& other : tiles) {
      if (gap_m(other) > near_m + reach_m + other.work.reach_m + blend_m) continue;
      const int id = other.parameters.tile;
      read.push_back(other.parameters);
      task->inputs.push_back({TileInputName(id, kResultFile), refine_task(id, part), kResultFile});
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
                     {{kCityFile, kIngest, kCityFile}, {kSurveyFile, kIngest, kSurveyFile}},
                     cost.peak_bytes});
  }
  for (const PlannedTile& tile : tiles) {
    const int id = tile.parameters.tile;
    const Prediction cost = PredictCrop(tile.work);
    PlannedTask task = {"crop",         TileName("crop", tile), id,
                        "{}",           cost.core_seconds,      {{kTileFile, cut_task(id), kTileFile}},
                        cost.peak_bytes};
    for (const int32_t view : tile.work.views) {
      task.scene_files.insert(task.scene_files.end(), files_of_view[view].begin(), files_of_view[view].end());
    }
    std::sort(task.scene_files.begin(), task.scene_files.end());
    tasks.push_back(std::move(task));
  }
  for (int part = 0; part <= last_part; ++part) {
    for (const PlannedTile& tile : tiles) {
      const int id = tile.parameters.tile;
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
                          id,
                          "",
                          cost.core_seconds,
                          {{kTileFile, cut_task(id), kTileFile}, {kViewsFile, crop_task(id), kViewsFile}},
                          cost.peak_bytes};
      if (part > 0) parameters.results = read_results(tile, part - 1, halo_m, &task);
      task.parameters = ToJson(parameters);
      tasks.push_back(std::move(task));
    }
  }
  for (const PlannedTile& tile : tiles) {
    const int id = tile.parameters.tile;
    const Prediction cost = PredictStitch(tile.work);
    PlannedTask task = {
        "stitch",       TileName("stitch", tile), id, "", cost.core_seconds, {{kTileFile, cut_task(id), kTileFile}},
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
                         {{kCityFile, kIngest, kCityFile}, {kSurveyFile, kIngest, kSurveyFile}},
                         cost.peak_bytes};
  for (const PlannedTile& tile : tiles) {
    const int id = tile.parameters.tile;
    parameters.tiles.push_back(tile.parameters);
    publish.inputs.push_back({TileInputName(id, kCoreFile), stitch_task(id), kCoreFile});
  }
  publish.parameters = ToJson(parameters);
  tasks.push_back(std::move(publish));
  return tasks;
}

}  // namespace tessera
