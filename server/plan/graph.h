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

// A file that a task reads: either a file of the scene, or the output `output` of an earlier task of the graph.
struct PlannedInput {
  std::string name;        // how the task sees it: a path relative to its input folder
  std::string scene_file;  // path relative to the scene's folder; empty if it comes from a task
  int task = -1;           // index of the producing task in the job's list of tasks
  std::string output;      // name of that task's output
};

struct PlannedTask {
  std::string kind;        // see TaskRequest
  std::string name;        // unique in the job, for people: "refine tile 3"
  int tile = -1;           // -1: the whole job
  std::string parameters;  // canonical JSON (sorted keys, no spaces)
  double cost = 1;         // predicted core-seconds; for progress, ETA, order and quotes
  std::vector<PlannedInput> inputs;
  int64_t peak_bytes = 0;  // predicted peak of a worker's resident memory; 0: not predicted
  // An earlier task of the job's list whose scene files this one reads too, after its own inputs; -1: none. The parts
  // of a tile read the same hundreds of images.
  int scene_inputs_of = -1;
};

// The first task of a job. `scene_files`: every file of the scene, relative, sorted.
StatusOr<PlannedTask> PlanIngest(const JobSettings& settings, const std::vector<std::string>& scene_files);

// The rest of the job, to be appended behind the ingest task (index 0), in an order where producers come first.
// `survey`: content of ingest's output "survey.json". Deterministic.
StatusOr<std::vector<PlannedTask>> PlanTiles(const JobSettings& settings, const std::string& survey);

// How far outside its core a tile reaches, metres.
StatusOr<double> HaloOf(const JobSettings& settings, const Survey& survey);

}  // namespace tessera

#endif  // TESSERA_SERVER_PLAN_GRAPH_H_
