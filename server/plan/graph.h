// From a job to its tasks, in phases: ingest; from what it found, the cut of every tile; from what the cuts found out
// about who reads whom, all the rest.
#ifndef TESSERA_SERVER_PLAN_GRAPH_H_
#define TESSERA_SERVER_PLAN_GRAPH_H_

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/ids.h"
#include "common/base/status.h"
#include "common/tile/task_parameters.h"
#include "server/settings/job_settings.h"

namespace tessera {

// Place of a task in its job's list of tasks. Producers come before those that read them.
using TaskId = Id<struct TaskTag>;

// An output of an earlier task of the graph, which a task reads. Cities have hundreds of thousands.
struct PlannedInput {
  TaskId task;         // that makes it
  std::string output;  // its name among that task's outputs
  int tile = -1;       // among the inputs it lies as TileInputName(tile, output); -1: under its own name
};

// How the task sees it: a path relative to its input folder.
std::string InputName(const PlannedInput& input);

struct PlannedTask {
  std::string kind;        // see TaskRequest
  std::string name;        // unique in the job, for people: "measure tile 3 step 7"
  int tile = -1;           // -1: the whole job
  std::string parameters;  // canonical JSON (sorted keys, no spaces)
  double cost = 1;         // predicted core-seconds; for progress, ETA, order and quotes
  std::vector<PlannedInput> inputs;
  int64_t peak_bytes = 0;  // predicted peak of a worker's resident memory; 0: not predicted
  // The scene's files that it reads, as ascending places in the scene's sorted list: cities have millions of such
  // inputs. The task sees each at its path below kSceneFolder.
  std::vector<int> scene_files = {};
};

// Kinds of tasks that the coordinator knows: what the next phase is planned from, and what ends a job.
inline constexpr char kIngestKind[] = "ingest";
inline constexpr char kCutKind[] = "cut";
inline constexpr char kPublishKind[] = "publish";

// Each gives the tasks of a phase, to be appended to those before. `scene_files`: every file of the scene, relative,
// sorted; `survey`: content of ingest's kSurveyFile. Deterministic.

// Phase 1: the first task of a job.
StatusOr<PlannedTask> PlanIngest(const JobSettings& settings, const std::vector<std::string>& scene_files);

// Phase 2: the cut of every tile, in order; of a single tile all that is left, publish at the end.
StatusOr<std::vector<PlannedTask>> PlanTiles(const JobSettings& settings, const std::string& survey,
                                             const std::vector<std::string>& scene_files);

// Phase 3, of more than one tile, publish at the end. `reads`: of each tile, as its cut wrote it.
StatusOr<std::vector<PlannedTask>> PlanSteps(const JobSettings& settings, const std::string& survey,
                                             const std::vector<std::string>& scene_files,
                                             const std::vector<TileReads>& reads);

}  // namespace tessera

#endif  // TESSERA_SERVER_PLAN_GRAPH_H_
