// The input files of tasks, the tasks that make them, and the key of a result: the hash of all that it depends on.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/storage/hash.h"
#include "server/ledger/job.h"

namespace tessera {

class Ledger;

// Digest of the input; NOT_FOUND while its producer has not succeeded.
StatusOr<Digest> InputDigest(const Job& job, const PlannedInput& input);
// Input files of the task under the names by which it reads them: task.inputs, then task.scene_files, then
// task.view_files. Errors as InputDigest.
StatusOr<std::vector<NamedDigest>> InputsOf(const Job& job, const PlannedTask& task);
// The task that can recompute this content: of the job itself (if `own`) or of its base jobs, nearest first.
// NOT_FOUND if no task made it.
StatusOr<TaskRef> MakerOf(const Ledger& ledger, int job, const Digest& digest, bool own);

// SHA-256 of the algorithm version, kind, parameters and the inputs' names and digests; their order does not matter.
std::string TaskKey(const std::string& algorithm_version, const std::string& kind, const std::string& parameters,
                    std::vector<NamedDigest> inputs);

}  // namespace tessera
