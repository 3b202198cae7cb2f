// A task with its inputs, parameters and predicted cost, as the planner returns it.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/container/inlined_vector.h"
#include "common/base/ids.h"
#include "common/base/interned_string.h"
#include "common/base/lazy_value.h"
#include "common/base/status.h"
#include "common/job/survey.h"
#include "common/job/task_kinds.h"
#include "common/job/task_parameters.h"
#include "common/storage/hash.h"
#include "server/tiling/cost_model.h"

namespace tessera {

// Index of a task in its job's list of tasks. A task comes after all tasks whose outputs it reads.
using TaskId = Id<struct TaskTag>;

// An input of a task: an output of an earlier task. Cities have hundreds of thousands.
struct PlannedInput {
  PlannedInput(TaskId made_by, InternedString name, int of_tile = -1)
      : task(made_by), tile(of_tile), output(std::move(name)) {}
  TaskId task;            // the producer
  int tile;               // the input's name is TileInputName(tile, output); -1: `output`
  InternedString output;  // its name among the producer's outputs
};

// Path of the input, relative to the reader's input folder.
std::string InputName(const PlannedInput& input);

struct PlannedTask {
  InternedString kind;     // a name in kTaskKinds
  std::string name;        // for display, unique in the job: "measure tile 3 step 7"
  int tile = -1;           // -1: the whole job
  std::string parameters;  // canonical JSON (sorted keys, no spaces)
  double cost = 1;         // predicted core-seconds, for progress, ETA, task order and quotes
  absl::InlinedVector<PlannedInput, 1> inputs;
  int64_t peak_bytes = 0;  // predicted peak of a worker's resident memory; 0: not predicted
  // The scene's files that it reads, as ascending indices in the scene's sorted list (cities have millions). The task
  // finds each at its path below kSceneFolder.
  LazyValue<std::vector<int>> scene_files = {};
  // Files of views, named ViewFileName or ViewMaskName. Not in the task's key, because other inputs contain their
  // digests.
  struct ViewFile {
    int file = 0;  // index in the scene's list
    int32_t view = 0;
    bool likelihoods = false;
    bool mask = false;
    friend bool operator==(const ViewFile&, const ViewFile&) = default;
  };
  LazyValue<std::vector<ViewFile>> view_files = {};
  // Outputs that are known at planning: if not empty, the task is not run. Contents are stored at planning.
  LazyValue<std::vector<NamedDigest>> given = {};
  LazyValue<std::vector<std::pair<std::string, std::string>>> given_contents = {};  // name, content; not recorded
  double scale = 1;          // factor of CostScale that `cost` contains; 0: not known
  int64_t stored_bytes = 0;  // predicted size of its outputs; 0: not predicted
  // Predicted core-seconds and outputs of the tasks that are planned from its outputs; 0: not predicted.
  double later_cost = 0;
  int64_t later_bytes = 0;
};

// Path of the file, relative to the reader's input folder.
std::string ViewInputName(const PlannedTask::ViewFile& file);

void SetCost(const Prediction& cost, PlannedTask* task);

// Sets what the report has from the survey: names, warnings, fit, source, skipped images. Without names of views, or
// source, if they take more than 1 MiB.
void SetReported(const Survey& survey, PublishParameters* parameters);

// Per view: its image, mask and likelihoods, as indices in the scene's sorted list of files. NOT_FOUND with the path of
// a missing one.
StatusOr<std::vector<std::vector<PlannedTask::ViewFile>>> FilesOfViews(const Survey& survey,
                                                                       const std::vector<std::string>& files);

}  // namespace tessera
