#include "server/plan/graph.h"

#include <algorithm>
#include <limits>
#include <optional>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/job/refine_steps.h"
#include "common/job/survey.h"
#include "server/plan/change_tasks.h"
#include "server/plan/classify_tasks.h"
#include "server/plan/crop_tasks.h"
#include "server/plan/export_tasks.h"
#include "server/plan/graph_tile.h"
#include "server/plan/publish_task.h"
#include "server/plan/stages.h"
#include "server/plan/update_plan.h"
#include "server/settings/export_settings.h"
#include "server/tiling/cell_index.h"
#include "server/tiling/cost_model.h"
#include "server/tiling/crop_groups.h"
#include "server/tiling/export_cost.h"
#include "server/tiling/quote.h"
#include "server/tiling/tiling.h"

namespace tessera {
namespace {

class Graph {
 public:
  static StatusOr<Graph> Create(const JobSettings& settings, const std::string& survey_json,
                                const std::vector<std::string>& scene_files, const UpdateBase* base,
                                const FinePart* fine) {
    Graph graph(settings);
    if (base == nullptr) {
      TESSERA_ASSIGN_OR_RETURN(std::vector<PlannedTask> survey, PlanIngest(settings, scene_files));
      for (PlannedTask& task : survey) graph.city_from_ = graph.survey_from_ = graph.Add(std::move(task));
      if (FirstFineStepOf(settings) > 0) graph.part_ = JobPart::kCoarse;
    } else {
      // The tasks of PlanUpdate.
      graph.base_from_ = graph.city_from_ = graph.Add(PlannedTask());
      for (int i = 0; i < base->inspections; ++i) graph.Add(PlannedTask());
      graph.survey_from_ = graph.Add(PlannedTask());
    }
    TESSERA_ASSIGN_OR_RETURN(graph.survey_, ParseSurvey(survey_json));
    TESSERA_ASSIGN_OR_RETURN(graph.files_of_view_, FilesOfViews(graph.survey_, scene_files));
    graph.classified_.resize(graph.survey_.views.size());
    const auto file = std::lower_bound(scene_files.begin(), scene_files.end(), kClassifierFile);
    if (file != scene_files.end() && *file == kClassifierFile) graph.classifier_file_ = file - scene_files.begin();
    const CellIndex cells(graph.survey_);
    if (base != nullptr) {
      TESSERA_RETURN_IF_ERROR(graph.TakeTiles(*base, cells));
      return graph;
    }
    const TilingOptions options = TilingOptionsOf(settings, graph.survey_);
    const Survey last = AfterSecondSplit(graph.survey_, options.effort);
    TESSERA_ASSIGN_OR_RETURN(const std::vector<CellRect> cores, LayOutTiles(CellIndex(last), options));
    for (const CellRect& core : cores) {
      GraphTile tile;
      tile.parameters = {static_cast<int>(graph.tiles_.size()), core};
      tile.work = MeasureTile(cells, core);
      graph.tiles_.push_back(std::move(tile));
    }
    if (fine != nullptr) {
      TESSERA_RETURN_IF_ERROR(graph.AddClassifiers());
      TESSERA_RETURN_IF_ERROR(graph.BeginFinePart(*fine));
    }
    return graph;
  }

  // Replaces the tasks of the coarse part by none. AddClassifiers must come first.
  Status BeginFinePart(const FinePart& fine) {
    part_ = JobPart::kFine;
    TESSERA_ASSIGN_OR_RETURN(survey_, SurveyOf(fine, survey_));
    tiles_ = TilesOf(fine, tiles_, survey_);
    city_from_ = survey_from_ = fine.split;
    tasks_.clear();
    first_ = static_cast<size_t>(fine.first_task);
    last_states_ = StageOf(kMendKind, FirstFineStepOf(settings_) - 1);
    return absl::OkStatus();
  }

  size_t tiles() const { return tiles_.size(); }
  bool continues_base() const { return continues_base_; }
  const Survey& survey() const { return survey_; }
  // Ids of the tiles that this job refines.
  std::vector<int> redone() const {
    std::vector<int> ids;
    for (const GraphTile& tile : tiles_) {
      if (tile.redone) ids.push_back(tile.parameters.tile);
    }
    return ids;
  }
  std::vector<int> cut() const {
    std::vector<int> ids = redone();
    std::erase_if(ids, [&](int id) { return tiles_[id].frozen_from == kNoCut; });
    return ids;
  }
  // Index of the next task.
  size_t size() const { return first_ + tasks_.size(); }
  std::vector<PlannedTask> TakeFrom(size_t first) && {
    tasks_.erase(tasks_.begin(), tasks_.begin() + static_cast<std::ptrdiff_t>(first - first_));
    return std::move(tasks_);
  }

  // Adds classify tasks for all views that tiles read, if the job computes likelihoods. In a job on the whole city
  // these views, and so the statistics of class borders, do not depend on the tiling. An update inherits the
  // statistics.
  Status AddClassifiers() {
    if (survey_.classifier.empty()) return absl::OkStatus();
    const bool by_default_rule = settings_.classifier == kDefaultClassifier, is_update = !tiles_of_base_.empty();
    if (!by_default_rule && classifier_file_ < 0)
      return absl::NotFoundError("the classifier is missing from the job's files");
    const std::set<int32_t> views = ViewsRead();
    int made = static_cast<int>(size());
    for (PlannedTask& task : PlanClassify({survey_, files_of_view_, views, by_default_rule ? -1 : classifier_file_,
                                           city_from_, size(), /*borders=*/!is_update})) {
      Add(std::move(task));
    }
    for (const int32_t v : views) classified_[v] = PlannedInput{TaskId(made++), ViewFileName(v, true)};
    borders_ = PlannedInput{is_update ? base_from_ : TaskId(made), kBordersFile};
    return absl::OkStatus();
  }

  void AddCuts() {
    std::vector<CellRect> cores;
    for (const GraphTile& tile : tiles_) cores.push_back(tile.parameters.core);
    const MethodSettings& method = settings_.method_settings;
    const std::vector<int> levels = LevelsOf(method);
    const int coarsest = part_ == JobPart::kFine ? levels.back() : *std::max_element(levels.begin(), levels.end());
    for (GraphTile& tile : tiles_) {
      if (!tile.redone || tile.left_out) continue;
      PlannedTask task = OnceAPart(TaskOf(tile, kCutKind, PredictCut(survey_, tile.work)));
      CutParameters parameters;
      parameters.tile = tile.parameters;
      parameters.cores = cores;
      parameters.window_px = method.window_px.value_or(parameters.window_px);
      parameters.coarsest_level = coarsest;
      parameters.borders = borders_.has_value();
      if (part_ == JobPart::kFine) SetFineIterations(settings_, &parameters);
      task.parameters = ToJson(parameters);
      task.inputs = {{city_from_, kCityFile}, {survey_from_, kPlainSurveyFile}};
      if (borders_) task.inputs.push_back(*borders_);
      if (part_ == JobPart::kFine) task.inputs.push_back({city_from_, kMovedFile});
      tile.cut = Add(std::move(task));
    }
  }

  // FAILED_PRECONDITION if a tile has no state to keep.
  Status Quarantine(const std::vector<FailedTile>& failed) {
    return FreezeTiles(failed, StagesWithGoodStates(settings_, survey_, continues_base_), part_ == JobPart::kFine,
                       continues_base_ && survey_.revision.has_value(), &tiles_);
  }

  // The states with which the fine part begins.
  void AddFineStarts() {
    for (GraphTile& tile : tiles_) {
      if (tile.gone()) continue;
      PlannedTask task = OnceAPart(TaskOf(tile, kStartKind, PredictStart(survey_, tile.work)));
      task.parameters = ToJson(StartParameters{tile.parameters, /*moved=*/true});
      task.inputs = {{city_from_, kCityFile}, {survey_from_, kPlainSurveyFile}, {city_from_, kMovedFile}};
      tile.state = PlannedInput{Add(std::move(task)), kStateFile, tile.parameters.tile};
    }
  }

  void AddCrops() {
    for (PlannedTask& task :
         PlanCrops({survey_, files_of_view_, classified_, size(), MaxCropGroupPeak_bytes(settings_)}, &tiles_)) {
      Add(OnceAPart(std::move(task)));
    }
  }

  void AddRefine() {
    GraphTile& tile = tiles_.front();
    RefineEffort effort = EffortOf(StepsOf(settings_), StepsTaken(settings_, survey_, continues_base_, part_));
    if (part_ != JobPart::kFine) effort.mends += 1;  // repair of the start
    PlannedTask task = OnceAPart(TaskOf(tile, kRefineKind, PredictRefine(tile.work, effort)));
    task.parameters = ToJson(RefineParameters{settings_.rounds, MethodName(), settings_.method_settings, part_});
    task.inputs = {{tile.cut, kTileFile}};
    ReadCrops(tile, &task);
    if (tile.state) task.inputs.push_back(*tile.state);
    tile.state = PlannedInput{Add(std::move(task)), kStateFile, 0};
  }

  // Adds the steps of several tiles. Each step reads the previous states of its tile and of others. `of_redone`: one
  // entry per tile of cut().
  void AddSteps(std::vector<TileReads> of_redone) {
    std::vector<TileReads> reads(tiles_.size());
    const std::vector<int> ids = cut();
    for (size_t i = 0; i < ids.size(); ++i) reads[ids[i]] = std::move(of_redone[i]);
    const std::vector<RefineStep> steps = StepsOf(settings_);
    const std::vector<int> taken = StepsTaken(settings_, survey_, continues_base_, part_);
    bool mended = continues_base_ || part_ == JobPart::kFine;  // these states are repaired
    if (continues_base_ && survey_.revision) AddMends(taken.empty() ? 0 : taken.front(), /*before=*/true, reads);
    for (const int s : taken) {
      const RefineStep& step = steps[s];
      if (!step.labels() && !mended) {
        AddMends(s, /*before=*/true, reads);
        mended = true;
      }
      AddMeasures(s, EffortOf(step), reads);
      AddSolves(s, step, reads);
      if (step.ends_level) AddMends(s, /*before=*/false, reads);
    }
  }

  Prediction CostOfChanges() const {
    Graph graph = *this;
    const size_t first = graph.size();
    graph.AddChanges();
    Prediction sum;
    for (size_t t = first; t < graph.size(); ++t) {
      sum += {graph.tasks_[t].cost, graph.tasks_[t].peak_bytes, graph.tasks_[t].stored_bytes};
    }
    return sum;
  }

  // Reserves the index of the task that AddPlan added in an earlier phase.
  void ReservePlan() { Add(PlannedTask()); }

  Status AddPlan(const UpdateBase& base) {
    TESSERA_ASSIGN_OR_RETURN(const Quote full, MakeQuote(settings_, survey_, costs_));
    const Prediction ingest = update_cost_, compare = CostOfChanges(),
                     publish = costs_.Corrected(kPublishKind, PredictPublish(survey_));
    TESSERA_ASSIGN_OR_RETURN(const Prediction exports, PredictExports(settings_, survey_));
    double core_seconds = ingest.core_seconds + publish.core_seconds + compare.core_seconds + exports.core_seconds;
    for (const TileChange& change : changes_) core_seconds += change.predicted.core_seconds;
    TESSERA_RETURN_IF_ERROR(CheckLimit(settings_, continues_base_ ? core_seconds : full.core_seconds));
    PlannedTask task;
    task.kind = task.name = kPlanKind;
    task.given_contents.Edit().emplace_back(
        kUpdateFile, UpdatePlanJson(base.name, !continues_base_, views_of_base_, base.tiles, changes_, survey_, ingest,
                                    compare, publish, full));
    Add(std::move(task));
    return absl::OkStatus();
  }

  void AddChanges() {
    ChangeWork work = {survey_,      files_of_view_, classified_, views_of_base_, base_from_, city_from_,
                       survey_from_, size(),         {},          outdated_};
    for (size_t t = 0; t < tiles_of_base_.size(); ++t) {
      if (tiles_of_base_[t].core.empty()) continue;
      const GraphTile& tile = tiles_[t];
      const PlannedInput of_base = {base_from_, TileInputName(tile.parameters.tile, kStateFile)};
      const auto after = tile.gone() ? std::nullopt : std::optional(tile.state.value_or(of_base));
      work.tiles.push_back({tile.gone() ? tiles_of_base_[t] : tile.parameters, of_base, after});
    }
    for (PlannedTask& task : PlanChanges(work)) changes_from_ = Add(std::move(task));  // the last reports
    if (changes_from_) outdated_ = PlannedInput{*changes_from_, kOutdatedFile};
  }

  // The end of a job or of its coarse part.
  Status AddEnd() {
    if (part_ != JobPart::kCoarse) return AddPublish();
    TESSERA_ASSIGN_OR_RETURN(PlannedTask split, PlanSplit(settings_, survey_, tiles_, tasks_, city_from_));
    Add(std::move(split));
    return absl::OkStatus();
  }

  // Publish, and the exports of its result.
  Status AddPublish() {
    const bool flips = MethodRulesOf(MethodName(), settings_.rounds, settings_.method_settings).flips_edges;
    PlannedTask task = PlanPublish({survey_, tiles_, city_from_, survey_from_, outdated_, flips});
    const TaskId mesh_from = Add(std::move(task));
    if (settings_.exports.formats.empty()) return absl::OkStatus();
    TESSERA_ASSIGN_OR_RETURN(const ExportOptions options, ExportOptionsOf(settings_.exports));
    ExportWork work = {options,    FormatsOf(options), survey_,   files_of_view_,
                       city_from_, survey_from_,       mesh_from, size()};
    for (const GraphTile& tile : tiles_) {
      if (tile.quarantined() && !tile.gone()) work.quarantined.push_back(tile.parameters.core);
    }
    if (changes_from_) work.changes = PlannedInput{*changes_from_, kChangesGeoJsonFile};
    TESSERA_ASSIGN_OR_RETURN(std::vector<PlannedTask> exports, PlanExports(work));
    for (PlannedTask& each : exports) Add(std::move(each));
    return absl::OkStatus();
  }

 private:
  explicit Graph(const JobSettings& settings) : settings_(settings) {}

  // Names a task that both parts have.
  PlannedTask OnceAPart(PlannedTask task) const {
    if (part_ == JobPart::kFine) task.name += ", finest level";
    return task;
  }

  TaskId Add(PlannedTask task) {
    task.scale = costs_.Of(task.kind);
    task.cost *= task.scale;
    tasks_.push_back(std::move(task));
    return TaskId(static_cast<int>(size()) - 1);
  }

  std::string MethodName() const { return settings_.method.empty() ? kMethods[0] : settings_.method; }

  std::set<int32_t> ViewsRead() const {
    std::set<int32_t> views;
    for (const GraphTile& tile : tiles_) views.insert(tile.work.views.begin(), tile.work.views.end());
    return views;
  }

  // Takes over the base's tiles and determines which ones the update refines.
  Status TakeTiles(const UpdateBase& base, const CellIndex& cells) {
    continues_base_ = !settings_.update.from_scratch;
    TESSERA_ASSIGN_OR_RETURN(const Survey base_survey, ParseSurvey(base.survey_json));
    if (survey_.revision) city_from_ = survey_from_;
    tiles_of_base_ = base.tiles;
    costs_ = CostsOf(base, base_survey);
    TESSERA_ASSIGN_OR_RETURN(
        changes_, FindChangedTiles(settings_, base_survey, survey_, TilesOfUpdate(base.tiles, survey_), costs_));
    views_of_base_ = base_survey.views.size();
    update_cost_ = costs_.Corrected(kIngestKind, PredictUpdateIngest(base_survey, survey_));
    if (base.outdated) outdated_ = PlannedInput{base_from_, kOutdatedFile};
    for (const TileChange& change : changes_) {
      GraphTile tile;
      tile.parameters = change.tile;
      tile.redone = !tile.gone() && (!continues_base_ || !change.why.empty());
      if (tile.redone) tile.work = MeasureTile(cells, change.tile.core);
      if (continues_base_ && !tile.gone() && static_cast<size_t>(change.tile.tile) < tiles_of_base_.size()) {
        tile.state = PlannedInput{base_from_, TileInputName(change.tile.tile, kStateFile)};
      }
      tiles_.push_back(std::move(tile));
    }
    update_cost_ += PredictViews(survey_, ViewsToClassify(base_survey, survey_, ViewsRead()), costs_);
    return absl::OkStatus();
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

  // Adds a task for each active tile of the stage. Their outputs become the latest only after all tasks are added,
  // because tasks of one stage must not read each other. Tiles that are no longer active have no sums.
  template <class Make>
  void AddForEach(LatestOutput latest, const char* file, int stage, const Make& make) {
    std::vector<std::pair<GraphTile*, TaskId>> made;
    for (GraphTile& tile : tiles_) {
      if (!tile.Works(stage)) tile.sums.reset();
    }
    for (GraphTile& tile : tiles_) {
      if (tile.Works(stage)) made.emplace_back(&tile, Add(make(tile)));
    }
    for (const auto& [tile, task] : made) tile->*latest = PlannedInput{task, file, tile->parameters.tile};
  }

  // Adds start tasks: tiles quarantined before their first step get a state when the other tiles get their first.
  void AddStarts(int stage) {
    last_states_ = stage;
    for (GraphTile& tile : tiles_) {
      if (!tile.redone || !tile.never_started() || tile.state) continue;
      PlannedTask task = TaskOf(tile, kStartKind, PredictStart(survey_, tile.work));
      task.parameters = ToJson(StartParameters{tile.parameters});
      task.inputs = {{city_from_, kCityFile}, {survey_from_, kPlainSurveyFile}};
      tile.state = PlannedInput{Add(std::move(task)), kStateFile, tile.parameters.tile};
    }
  }

  void AddMeasures(int s, const RefineEffort& effort, const std::vector<TileReads>& reads) {
    const int stage = StageOf(kMeasureKind, s);
    AddForEach(&GraphTile::sums, kSumsFile, stage, [&](const GraphTile& tile) {
      PlannedTask task = StepTask(tile, kMeasureKind, PredictMeasure(tile.work, effort), s);
      ReadCrops(tile, &task);
      StepParameters parameters = ParametersOf(tile, s);
      parameters.states = ReadLatest(tiles_, &GraphTile::state, reads[tile.parameters.tile].visibility, &task);
      parameters.frozen = FrozenOf(tiles_, parameters.states, last_states_);  // all other states are of the same stage
      task.parameters = ToJson(parameters);
      return task;
    });
  }

  void AddSolves(int s, const RefineStep& step, const std::vector<TileReads>& reads) {
    const int stage = StageOf(kSolveKind, s);
    AddStarts(stage);
    AddForEach(&GraphTile::state, kStateFile, stage, [&](const GraphTile& tile) {
      PlannedTask task = StepTask(tile, kSolveKind, PredictSolve(tile.work, EffortOf(step)), s);
      const TileReads& of_tile = reads[tile.parameters.tile];
      const std::vector<int>& ids = step.labels() ? of_tile.label : of_tile.solve;
      StepParameters parameters = ParametersOf(tile, s);
      parameters.sums = ReadLatest(tiles_, &GraphTile::sums, ids, &task);
      parameters.states = ReadLatest(tiles_, &GraphTile::state, ids, &task);
      parameters.frozen = FrozenOf(tiles_, parameters.states, stage);
      parameters.continues_base = continues_base_ && !survey_.revision && s == UpdateSteps(settings_, survey_).front();
      task.parameters = ToJson(parameters);
      return task;
    });
  }

  void AddMends(int s, bool before, const std::vector<TileReads>& reads) {
    RefineEffort effort;
    effort.mends = 1;
    const int stage = StageOf(kMendKind, s, before);
    AddStarts(stage);
    AddForEach(&GraphTile::state, kStateFile, stage, [&](const GraphTile& tile) {
      PlannedTask task = StepTask(tile, kMendKind, PredictMend(tile.work, effort), s);
      if (before) task.name = absl::StrCat("mend tile ", task.tile, " before step ", s);
      StepParameters parameters = ParametersOf(tile, s);
      parameters.before = before;
      parameters.states = ReadLatest(tiles_, &GraphTile::state, reads[tile.parameters.tile].repair, &task);
      parameters.frozen = FrozenOf(tiles_, parameters.states, stage);
      if (before && continues_base_) {
        parameters.continues_base = true;
        parameters.first_new_face = survey_.revision->first_new_face;
      }
      task.parameters = ToJson(parameters);
      return task;
    });
  }

  JobSettings settings_;
  Survey survey_;
  JobPart part_ = JobPart::kWhole;
  std::vector<std::vector<PlannedTask::ViewFile>> files_of_view_;
  std::vector<GraphTile> tiles_;
  std::vector<PlannedTask> tasks_;
  size_t first_ = 0;  // index of the first of `tasks_`
  std::vector<std::optional<PlannedInput>> classified_;  // per view: likelihoods computed by the job
  std::optional<PlannedInput> borders_;                  // statistics of their class borders
  int classifier_file_ = -1;                             // index in the scene's files; -1: none
  TaskId base_from_, city_from_, survey_from_;
  std::vector<TileParameters> tiles_of_base_;
  // Stage of the latest states of active tiles.
  int last_states_ = std::numeric_limits<int>::min();
  bool continues_base_ = false;      // start from the base's states and refine only changed tiles
  std::vector<TileChange> changes_;  // of an update
  size_t views_of_base_ = 0;
  std::optional<PlannedInput> outdated_;  // kOutdatedFile of the base; after AddChanges, of its last task
  std::optional<TaskId> changes_from_;
  Prediction update_cost_;
  CostScale costs_;
};

}  // namespace

StatusOr<std::vector<PlannedTask>> PlanTiles(const JobSettings& settings, const std::string& survey,
                                             const std::vector<std::string>& scene_files, const UpdateBase* base,
                                             const FinePart* fine) {
  TESSERA_ASSIGN_OR_RETURN(Graph graph, Graph::Create(settings, survey, scene_files, base, fine));
  TESSERA_RETURN_IF_ERROR(CheckExports(settings, graph.survey()));
  const size_t first = graph.size();
  if (fine != nullptr) {
    // The quote and the steps were checked before the coarse part.
  } else if (base != nullptr) {
    TESSERA_RETURN_IF_ERROR(graph.AddPlan(*base));
    if (settings.update.plan_only) return std::move(graph).TakeFrom(first);
    if (graph.redone().empty()) {
      TESSERA_RETURN_IF_ERROR(graph.AddPublish());
      return std::move(graph).TakeFrom(first);
    }
  } else {
    TESSERA_RETURN_IF_ERROR(CheckQuote(settings, graph.survey()));
  }
  if (fine == nullptr) {
    TESSERA_RETURN_IF_ERROR(CheckSteps(settings, graph.survey(), graph.continues_base()));
    TESSERA_RETURN_IF_ERROR(graph.AddClassifiers());
  }
  graph.AddCuts();
  if (graph.tiles() == 1 && !graph.continues_base()) {
    if (fine != nullptr) graph.AddFineStarts();
    graph.AddCrops();
    graph.AddRefine();
    if (base != nullptr) graph.AddChanges();
    TESSERA_RETURN_IF_ERROR(graph.AddEnd());
  }
  return std::move(graph).TakeFrom(first);
}

StatusOr<std::vector<PlannedTask>> PlanSteps(const JobSettings& settings, const std::string& survey,
                                             const std::vector<std::string>& scene_files,
                                             const std::vector<TileReads>& reads, const UpdateBase* base,
                                             const std::vector<FailedTile>& quarantined, const FinePart* fine) {
  TESSERA_ASSIGN_OR_RETURN(Graph graph, Graph::Create(settings, survey, scene_files, base, fine));
  if (base != nullptr) graph.ReservePlan();
  TESSERA_RETURN_IF_ERROR(graph.Quarantine(quarantined));
  TESSERA_RETURN_IF_ERROR(CheckReads(reads, graph.cut().size(), graph.tiles()));
  if (fine == nullptr) TESSERA_RETURN_IF_ERROR(graph.AddClassifiers());
  graph.AddCuts();
  const size_t first = graph.size();
  if (fine != nullptr) graph.AddFineStarts();
  graph.AddCrops();
  graph.AddSteps(reads);
  if (base != nullptr) graph.AddChanges();
  TESSERA_RETURN_IF_ERROR(graph.AddEnd());
  return std::move(graph).TakeFrom(first);
}

}  // namespace tessera
