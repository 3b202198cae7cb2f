// What a job waits for that the coordinator does by itself: the next phase of its plan, or its end. Included by the
// dispatcher's .cc files only.
#ifndef TESSERA_SERVER_JOBS_PENDING_STEP_H_
#define TESSERA_SERVER_JOBS_PENDING_STEP_H_

#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/jobs/dispatcher.h"

namespace tessera {

struct Dispatcher::PendingStep {
  enum class Kind { kPlanIngest, kPlanUpdate, kPlanTiles, kPlanSteps, kSetAside, kEnd };
  Kind kind = Kind::kEnd;
  int job = -1;
  int tasks = 0;  // of the job, before the phase that is to be planned: a plan for another number is stale
  JobSettings settings;
  std::vector<NamedDigest> scene_files;
  std::optional<StatusOr<UpdateBase>> base;  // of an update
  StatusOr<Digest> survey = absl::UnknownError("not read");
  std::vector<std::pair<int, StatusOr<Digest>>> reads;  // tiles that were cut, and the kReadsFile of each
  int tiles = 0;                                        // up to the last of which a cut was planned
  std::vector<SetAsideTile> set_aside;
  int replaces_from = -1;            // first task that the phase is planned in place of; -1: none
  int failed = -1;                   // task whose tile is set aside
  JobState end = JobState::kFailed;  // of a job that ends
  std::string error;                 // likewise
  int64_t end_us = 0;                // likewise, and when
  std::map<int, std::string> why_set_aside;
  JobHeader header;
  std::vector<NamedDigest> artifacts;
};

}  // namespace tessera

#endif  // TESSERA_SERVER_JOBS_PENDING_STEP_H_
