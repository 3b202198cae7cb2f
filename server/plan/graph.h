// From a job to its tasks, in phases: ingest; from what it found, the cut of every tile; from what the cuts found out
// about who reads whom, all the rest.
#ifndef TESSERA_SERVER_PLAN_GRAPH_H_
#define TESSERA_SERVER_PLAN_GRAPH_H_

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/container/inlined_vector.h"
#include "common/base/ids.h"
#include "common/base/interned_string.h"
#include "common/base/lazy_value.h"
#include "common/base/status.h"
#include "common/job/task_parameters.h"
#include "common/storage/hash.h"
#include "server/plan/cost_scale.h"
#include "server/settings/job_settings.h"

namespace tessera {

// Place of a task in its job's list of tasks. Producers come before those that read them.
using TaskId = Id<struct TaskTag>;

// An output of an earlier task of the graph, which a task reads. Cities have hundreds of thousands.
struct PlannedInput {
  PlannedInput(TaskId made_by, InternedString name, int of_tile = -1)
      : task(made_by), tile(of_tile), output(std::move(name)) {}
  TaskId task;            // that makes it
  int tile;               // among the inputs it lies as TileInputName(tile, output); -1: under its own name
  InternedString output;  // its name among that task's outputs
};

// How the task sees it: a path relative to its input folder.
std::string InputName(const PlannedInput& input);

struct PlannedTask {
  InternedString kind;     // see TaskRequest
  std::string name;        // unique in the job, for people: "measure tile 3 step 7"
  int tile = -1;           // -1: the whole job
  std::string parameters;  // canonical JSON (sorted keys, no spaces)
  double cost = 1;         // predicted core-seconds; for progress, ETA, order and quotes
  absl::InlinedVector<PlannedInput, 1> inputs;
  int64_t peak_bytes = 0;  // predicted peak of a worker's resident memory; 0: not predicted
  // The scene's files that it reads, as ascending places in the scene's sorted list: cities have millions of such
  // inputs. The task sees each at its path below kSceneFolder.
  LazyValue<std::vector<int>> scene_files = {};
  // Files of views, which it sees under ViewFileName. They are not in the task's key: other inputs tell their content.
  struct ViewFile {
    int file = 0;  // place in the scene's list
    int32_t view = 0;
    bool likelihoods = false;
    friend bool operator==(const ViewFile&, const ViewFile&) = default;
  };
  LazyValue<std::vector<ViewFile>> view_files = {};
  // Not empty: outputs that are known beforehand; nothing runs. Contents are stored when the task is planned.
  LazyValue<std::vector<NamedDigest>> given = {};
  LazyValue<std::vector<std::pair<std::string, std::string>>> given_contents = {};  // name, content; not recorded
  double scale = 1;          // in `cost`, of CostScale; 0: not known
  int64_t stored_bytes = 0;  // predicted size of its outputs; 0: not predicted
};

// Kinds of tasks that the coordinator knows: what the next phase is planned from, and what ends a job.
inline constexpr char kIngestKind[] = "ingest";
inline constexpr char kUpdateKind[] = "update";  // in place of ingest, of a job that goes on from another
inline constexpr char kBaseKind[] = "base";      // given: what the other job made
inline constexpr char kPlanKind[] = "plan";      // given: kUpdateFile
inline constexpr char kChangesKind[] = "changes";
inline constexpr char kClassifyKind[] = "classify";  // a view
inline constexpr char kBordersKind[] = "borders";    // after these
inline constexpr char kCutKind[] = "cut";
inline constexpr char kCropKind[] = "crop";
inline constexpr char kMeasureKind[] = "measure";
inline constexpr char kSolveKind[] = "solve";
inline constexpr char kMendKind[] = "mend";
inline constexpr char kStartKind[] = "start";  // a tile's core as the job found it
inline constexpr char kPublishKind[] = "publish";

// What an update takes from the job that it goes on from.
struct UpdateBase {
  std::string name;            // "jobs/J"
  Digest survey, plain, city;  // its kSurveyFile, kPlainSurveyFile and kCityFile
  std::string survey_json;     // content of `survey`
  std::vector<TileParameters> tiles;
  std::vector<Digest> states;            // the last of each tile; of one that is gone none, a Digest()
  std::optional<Digest> outdated;        // its kOutdatedFile
  std::optional<Digest> borders;         // its kBordersFile, if it made its likelihoods itself
  bool flip_edges = false;               // in what it published
  std::vector<NamedDigest> scene_files;  // those of the base, sorted by name
  // Of the base and those that it goes on from; of ingest, which took the survey of the base, its own alone.
  MeasuredCosts measured;
};

// An update's list of scene files has those of its own scene, and those of its base whose content it lacks, under names
// that tell their content: the files lie where the base has them.
std::string CarriedName(const NamedDigest& file_of_base);
bool IsCarried(const std::string& name);
// In the scene's folder: neither carried nor kClassifierFile, which is a blob.
bool LiesInScene(const std::string& name);

// Each gives the tasks of a phase, to be appended to those before. `scene_files`: every file of the scene, relative,
// sorted; `survey`: content of ingest's kSurveyFile. Deterministic.

// Phase 1: the first task of a job.
StatusOr<PlannedTask> PlanIngest(const JobSettings& settings, const std::vector<std::string>& scene_files);

// The same of an update: what it takes from its base (given), and the task that takes the survey on. `scene_files`:
// sorted by name. Of one that goes back to an earlier job all tasks (PlanRollback).
StatusOr<std::vector<PlannedTask>> PlanUpdate(const JobSettings& settings, const std::vector<NamedDigest>& scene_files,
                                              const UpdateBase& base);

// Phase 2: the cut of every tile, in order; of a single tile all that is left, publish at the end. Of an update
// (`base` not null): its plan (given), and the cuts of the tiles that are redone; publish, if there are none.
StatusOr<std::vector<PlannedTask>> PlanTiles(const JobSettings& settings, const std::string& survey,
                                             const std::vector<std::string>& scene_files,
                                             const UpdateBase* base = nullptr);

// A tile that is left as it was because a task of it failed for good. Its neighbours hold what they share with it.
struct SetAsideTile {
  int tile = -1;
  std::string kind;     // of the task: cut, crop, measure, solve or mend
  int step = -1;        // of the last three, as in StepParameters
  bool before = false;  // likewise
  friend bool operator==(const SetAsideTile&, const SetAsideTile&) = default;
};

// Phase 3, of more than one tile or an update, publish at the end. `reads`: of each tile that was cut, in order, as its
// cut wrote it. `set_aside`: tiles that stay as they were with the last state without folds before the task that
// failed: what they did until then is planned as without this. FAILED_PRECONDITION if one has nothing that could stay.
StatusOr<std::vector<PlannedTask>> PlanSteps(const JobSettings& settings, const std::string& survey,
                                             const std::vector<std::string>& scene_files,
                                             const std::vector<TileReads>& reads, const UpdateBase* base = nullptr,
                                             const std::vector<SetAsideTile>& set_aside = {});

}  // namespace tessera

#endif  // TESSERA_SERVER_PLAN_GRAPH_H_
