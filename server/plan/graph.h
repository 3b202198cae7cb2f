// From a job to its tasks: ingest first, then, from what ingest found, cut, refine, stitch and publish.
#ifndef TESSERA_SERVER_PLAN_GRAPH_H_
#define TESSERA_SERVER_PLAN_GRAPH_H_

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/tile/survey.h"
#include "server/settings/job_settings.h"

namespace tessera {

// An output of an earlier task of the graph, which a task reads.
struct PlannedInput {
  std::string name;    // how the task sees it: a path relative to its input folder
  int task = 0;        // index of the producing task in the job's list of tasks
  std::string output;  // name of that task's output
};

struct PlannedTask {
  std::string kind;        // see TaskRequest
  std::string name;        // unique in the job, for people: "refine tile 3"
  int tile = -1;           // -1: the whole job
  std::string parameters;  // canonical JSON (sorted keys, no spaces)
  double cost = 1;         // predicted core-seconds; for progress, ETA, order and quotes
  std::vector<PlannedInput> inputs;
  int64_t peak_bytes = 0;  // predicted peak of a worker's resident memory; 0: not predicted
  // The scene's files that it reads, as ascending places in the scene's sorted list: cities have millions of such
  // inputs. The task sees each at its path below kSceneFolder.
  std::vector<int> scene_files = {};
};

// The first task of a job. `scene_files`: every file of the scene, relative, sorted.
StatusOr<PlannedTask> PlanIngest(const JobSettings& settings, const std::vector<std::string>& scene_files);

// The rest of the job, to be appended behind the ingest task (index 0), in an order where producers come first.
// `survey`: content of ingest's output "survey.json"; `scene_files`: as PlanIngest had them. Deterministic.
StatusOr<std::vector<PlannedTask>> PlanTiles(const JobSettings& settings, const std::string& survey,
                                             const std::vector<std::string>& scene_files);

// How far outside its core a tile reaches, metres.
StatusOr<double> HaloOf(const JobSettings& settings, const Survey& survey);

}  // namespace tessera

#endif  // TESSERA_SERVER_PLAN_GRAPH_H_
