// A task of a worker: a pure function from a folder of input files to a folder of output files.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"

namespace tessera {

// Everything that determines the outputs: kind, parameters and the bytes of the inputs. Nothing else may be read.
struct TaskRequest {
  std::string kind;        // a name in kTaskKinds (common/job/task_kinds.h)
  std::string parameters;  // canonical JSON, made by server/plan
  std::string input_dir;   // inputs by name (names may contain folders), read-only
  std::string output_dir;  // initially empty
  // Brings inputs that are fetched on demand (FetchedOnDemand) into input_dir. Call it from the task's thread.
  FetchFiles fetch = {};
};

struct TaskOutcome {
  std::vector<std::string> outputs;  // names of the files written, relative to output_dir
  std::string stats;                 // JSON for the report: energies, counts, seconds; never part of a key
  Warnings warnings;
  bool found_faults = false;  // an output says that inputs cannot be read
};

// Runs one task. Outputs are byte-equal for equal inputs. INVALID_ARGUMENT, NOT_FOUND, OUT_OF_RANGE and DATA_LOSS:
// the inputs are wrong or inconsistent. RESOURCE_EXHAUSTED: out of memory, unless IsFileError. CANCELLED if `control`
// is cancelled. worker/agent maps errors to failure classes.
StatusOr<TaskOutcome> RunTask(const TaskRequest& request, const TaskControl& control);

}  // namespace tessera
