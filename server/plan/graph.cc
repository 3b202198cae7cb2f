#include "server/plan/graph.h"

#include <algorithm>
#include <numeric>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/tile/refine_steps.h"
#include "common/tile/survey.h"
#include "server/plan/cell_index.h"
#include "server/plan/cost_model.h"
#include "server/plan/tiling.h"

namespace tessera {
namespace {

constexpr double kIngestSecondsPerFile = 0.1;  // before the survey tells more

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

// A tile with those of its tasks that others read, as far as they are planned.
struct GraphTile {
  TileParameters parameters;
  TileWork work;
  TaskId cut, crop;
  std::optional<TaskId> sums, state;  // that made the latest
};

// The job's list of tasks as it grows.
class Graph {
 public:
  static StatusOr<Graph> Create(const JobSettings& settings, const std::string& survey_json,
                                const std::vector<std::string>& scene_files) {
    Graph graph(settings);
    TESSERA_ASSIGN_OR_RETURN(PlannedTask ingest, PlanIngest(settings, scene_files));
    graph.ingest_ = graph.Add(std::move(ingest));
    TESSERA_ASSIGN_OR_RETURN(graph.survey_, ParseSurvey(survey_json));
    TESSERA_ASSIGN_OR_RETURN(graph.files_of_view_, FilesOfViews(graph.survey_, scene_files));
    const CellIndex cells(graph.survey_);
    const TilingOptions options = TilingOptionsOf(settings, graph.survey_);
    graph.effort_ = options.effort;
    TESSERA_ASSIGN_OR_RETURN(const std::vector<CellRect> cores, LayOutTiles(cells, options));
    for (const CellRect& core : cores) {
      GraphTile tile;
      tile.parameters = {static_cast<int>(graph.tiles_.size()), core};
      tile.work = MeasureTile(cells, core);
      graph.tiles_.push_back(std::move(tile));
    }
    return graph;
  }

  size_t tiles() const { return tiles_.size(); }
  size_t size() const { return tasks_.size(); }
  std::vector<PlannedTask> TakeFrom(size_t first) && {
    tasks_.erase(tasks_.begin(), tasks_.begin() + static_cast<std::ptrdiff_t>(first));
    return std::move(tasks_);
  }

  void AddCuts() {
    std::vector<CellRect> cores;
    for (const GraphTile& tile : tiles_) cores.push_back(tile.parameters.core);
    const MethodSettings& method = settings_.method_settings;
    const std::vector<int>& levels = method.levels.empty() ? ListSettings()[0].standard : method.levels;
    const int coarsest = *std::max_element(levels.begin(), levels.end());
    for (GraphTile& tile : tiles_) {
      PlannedTask task = TaskOf(tile, kCutKind, PredictCut(survey_, tile.work));
      CutParameters parameters;
      parameters.tile = tile.parameters;
      parameters.cores = cores;
      parameters.window_px = method.window_px.value_or(parameters.window_px);
      parameters.coarsest_level = coarsest;
      task.parameters = ToJson(parameters);
      task.inputs = {{ingest_, kCityFile}, {ingest_, kSurveyFile}};
      tile.cut = Add(std::move(task));
    }
  }

  void AddCrops() {
    for (GraphTile& tile : tiles_) {
      PlannedTask task = TaskOf(tile, "crop", PredictCrop(tile.work));
      task.parameters = "{}";
      task.inputs = {{tile.cut, kTileFile}};
      for (const int32_t view : tile.work.views) {
        const std::vector<int>& files = files_of_view_[view];
        task.scene_files.insert(task.scene_files.end(), files.begin(), files.end());
      }
      std::sort(task.scene_files.begin(), task.scene_files.end());
      tile.crop = Add(std::move(task));
    }
  }

  // All steps of the only tile.
  void AddRefine() {
    GraphTile& tile = tiles_.front();
    PlannedTask task = TaskOf(tile, "refine", PredictRefine(tile.work, effort_));
    task.parameters = ToJson(RefineParameters{settings_.rounds, MethodName(), settings_.method_settings});
    task.inputs = {{tile.cut, kTileFile}, {tile.crop, kViewsFile}};
    tile.state = Add(std::move(task));
  }

  // The steps of several tiles, each of which reads what the steps before left of itself and others.
  void AddSteps(const std::vector<TileReads>& reads) {
    const MethodSettings& method = settings_.method_settings;
    const std::vector<RefineStep> steps = RefineStepsOf(settings_.method, settings_.rounds, method);
    const LabelTraits traits = {static_cast<int>(survey_.classes.size()), survey_.has_likelihoods, survey_.has_labels};
    bool mended = false;  // the start
    for (const int s : ActiveSteps(steps, MethodRulesOf(settings_.method, settings_.rounds, method), traits)) {
      const RefineStep& step = steps[s];
      if (!step.labels() && !mended) {
        AddMends(s, /*before=*/true, reads);
        mended = true;
      }
      AddMeasures(s, EffortOf(step), reads);
      AddSolves(s, step, reads);
      if (step.ends_level) AddMends(s, /*before=*/false, reads);
    }
    if (!mended) AddMends(static_cast<int>(steps.size()) - 1, /*before=*/true, reads);  // publish needs a state
  }

  void AddPublish() {
    PublishParameters parameters;
    PlannedTask task;
    task.kind = task.name = kPublishKind;
    SetCost(PredictPublish(survey_), &task);
    task.inputs = {{ingest_, kCityFile}, {ingest_, kSurveyFile}};
    for (const GraphTile& tile : tiles_) {
      parameters.tiles.push_back(tile.parameters);
      task.inputs.push_back({*tile.state, kStateFile, tile.parameters.tile});
    }
    task.parameters = ToJson(parameters);
    Add(std::move(task));
  }

 private:
  explicit Graph(const JobSettings& settings) : settings_(settings) {}

  TaskId Add(PlannedTask task) {
    tasks_.push_back(std::move(task));
    return TaskId(static_cast<int>(tasks_.size()) - 1);
  }

  std::string MethodName() const { return settings_.method.empty() ? kMethods[0] : settings_.method; }

  static void SetCost(const Prediction& cost, PlannedTask* task) {
    task->cost = cost.core_seconds;
    task->peak_bytes = cost.peak_bytes;
  }

  static PlannedTask TaskOf(const GraphTile& tile, const char* kind, const Prediction& cost) {
    PlannedTask task;
    task.kind = kind;
    task.tile = tile.parameters.tile;
    task.name = absl::StrCat(kind, " tile ", task.tile);
    SetCost(cost, &task);
    return task;
  }

  PlannedTask StepTask(const GraphTile& tile, const char* kind, const Prediction& cost, int step) const {
    PlannedTask task = TaskOf(tile, kind, cost);
    absl::StrAppend(&task.name, " step ", step);
    task.inputs = {{tile.cut, kTileFile}};
    return task;
  }

  StepParameters ParametersOf(const GraphTile& tile, int step) const {
    StepParameters parameters = {settings_.rounds, MethodName(), settings_.method_settings, step};
    parameters.tile = tile.parameters;
    return parameters;
  }

  // Makes the states of the tiles, or their sums, inputs of the task; gives the tiles that have some.
  std::vector<int> Read(std::optional<TaskId> GraphTile::*latest, const char* file, const std::vector<int>& ids,
                        PlannedTask* task) const {
    std::vector<int> read;
    for (const int id : ids) {
      const std::optional<TaskId>& made_by = tiles_[id].*latest;
      if (!made_by) continue;
      task->inputs.push_back({*made_by, file, id});
      read.push_back(id);
    }
    return read;
  }

  // The tasks that make what others of the same step must not read yet take its place when all are there.
  void Replace(std::optional<TaskId> GraphTile::*latest, const std::vector<TaskId>& made) {
    for (size_t t = 0; t < tiles_.size(); ++t) tiles_[t].*latest = made[t];
  }

  void AddMeasures(int s, const RefineEffort& effort, const std::vector<TileReads>& reads) {
    std::vector<TaskId> made;
    for (const GraphTile& tile : tiles_) {
      PlannedTask task = StepTask(tile, "measure", PredictMeasure(tile.work, effort), s);
      task.inputs.push_back({tile.crop, kViewsFile});
      StepParameters parameters = ParametersOf(tile, s);
      parameters.states = Read(&GraphTile::state, kStateFile, reads[tile.parameters.tile].sight, &task);
      task.parameters = ToJson(parameters);
      made.push_back(Add(std::move(task)));
    }
    Replace(&GraphTile::sums, made);
  }

  void AddSolves(int s, const RefineStep& step, const std::vector<TileReads>& reads) {
    std::vector<TaskId> made;
    for (const GraphTile& tile : tiles_) {
      PlannedTask task = StepTask(tile, "solve", PredictSolve(tile.work, EffortOf(step)), s);
      const TileReads& of_tile = reads[tile.parameters.tile];
      const std::vector<int>& ids = step.labels() ? of_tile.label : of_tile.solve;
      StepParameters parameters = ParametersOf(tile, s);
      parameters.sums = Read(&GraphTile::sums, kSumsFile, ids, &task);
      parameters.states = Read(&GraphTile::state, kStateFile, ids, &task);
      task.parameters = ToJson(parameters);
      made.push_back(Add(std::move(task)));
    }
    Replace(&GraphTile::state, made);
  }

  void AddMends(int s, bool before, const std::vector<TileReads>& reads) {
    RefineEffort effort;
    effort.mends = 1;
    std::vector<TaskId> made;
    for (const GraphTile& tile : tiles_) {
      PlannedTask task = StepTask(tile, "mend", PredictMend(tile.work, effort), s);
      if (before) task.name = absl::StrCat("mend tile ", task.tile, " before step ", s);
      StepParameters parameters = ParametersOf(tile, s);
      parameters.before = before;
      parameters.states = Read(&GraphTile::state, kStateFile, reads[tile.parameters.tile].mend, &task);
      task.parameters = ToJson(parameters);
      made.push_back(Add(std::move(task)));
    }
    Replace(&GraphTile::state, made);
  }

  JobSettings settings_;
  Survey survey_;
  RefineEffort effort_;
  std::vector<std::vector<int>> files_of_view_;
  std::vector<GraphTile> tiles_;
  std::vector<PlannedTask> tasks_;
  TaskId ingest_;
};

}  // namespace

std::string InputName(const PlannedInput& input) {
  return input.tile < 0 ? input.output : TileInputName(input.tile, input.output);
}

StatusOr<PlannedTask> PlanIngest(const JobSettings& settings, const std::vector<std::string>& scene_files) {
  TESSERA_RETURN_IF_ERROR(CheckJobSettings(settings));
  if (scene_files.empty()) return absl::InvalidArgumentError("the scene has no files");
  PlannedTask task;
  task.kind = task.name = kIngestKind;
  task.parameters =
      ToJson(IngestParameters{settings.method_settings.partners, settings.method_settings.views_per_direction});
  task.cost = kIngestSecondsPerFile * static_cast<double>(scene_files.size());
  task.scene_files.resize(scene_files.size());
  std::iota(task.scene_files.begin(), task.scene_files.end(), 0);
  return task;
}

StatusOr<std::vector<PlannedTask>> PlanTiles(const JobSettings& settings, const std::string& survey,
                                             const std::vector<std::string>& scene_files) {
  TESSERA_ASSIGN_OR_RETURN(Graph graph, Graph::Create(settings, survey, scene_files));
  const size_t first = graph.size();
  graph.AddCuts();
  if (graph.tiles() == 1) {
    graph.AddCrops();
    graph.AddRefine();
    graph.AddPublish();
  }
  return std::move(graph).TakeFrom(first);
}

StatusOr<std::vector<PlannedTask>> PlanSteps(const JobSettings& settings, const std::string& survey,
                                             const std::vector<std::string>& scene_files,
                                             const std::vector<TileReads>& reads) {
  TESSERA_ASSIGN_OR_RETURN(Graph graph, Graph::Create(settings, survey, scene_files));
  if (graph.tiles() != reads.size()) {
    return absl::FailedPreconditionError(absl::StrCat("the job was cut in ", reads.size(), " tiles, expected ",
                                                      graph.tiles(), ", as this version lays them out"));
  }
  for (const TileReads& of_tile : reads) {
    for (const std::vector<int>* ids : {&of_tile.label, &of_tile.mend, &of_tile.sight, &of_tile.solve}) {
      for (const int id : *ids) {
        if (id >= 0 && id < static_cast<int>(reads.size())) continue;
        return absl::InvalidArgumentError(absl::StrCat("reads: found tile ", id, " of ", reads.size()));
      }
    }
  }
  graph.AddCuts();
  const size_t first = graph.size();
  graph.AddCrops();
  graph.AddSteps(reads);
  graph.AddPublish();
  return std::move(graph).TakeFrom(first);
}

}  // namespace tessera
