// The next step of a job that needs no worker: to plan a phase, to quarantine a tile, or to end.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "server/jobs/tile_quarantine.h"
#include "server/leases/dispatch_core.h"
#include "server/plan/graph.h"

namespace tessera {

struct PendingStep {
  enum class Kind { kPlanIngest, kPlanUpdate, kPlanTiles, kPlanSteps, kQuarantine, kEnd };
  Kind kind = Kind::kEnd;
  int job = -1;
  int tasks = 0;  // of the job, before the phase that is to be planned: a plan for another number is stale
  JobSettings settings;
  std::vector<NamedDigest> scene_files;
  std::optional<StatusOr<UpdateBase>> base;  // of an update
  StatusOr<Digest> survey = absl::UnknownError("not read");
  std::vector<std::pair<int, StatusOr<Digest>>> reads;  // tiles that were cut, and the kReadsFile of each
  int tiles = 0;                                        // up to the last of which a cut was planned
  std::vector<FailedTile> quarantined;
  int replaces_from = -1;            // first task that the phase is planned in place of; -1: none
  int failed = -1;                   // task whose tile is quarantined
  JobState end = JobState::kFailed;  // of a job that ends
  std::string error;                 // likewise
  int64_t end_us = 0;                // likewise, and when
  std::map<int, std::string> why_quarantined;
  JobHeader header;
  std::vector<NamedDigest> artifacts;
};

// The step of the oldest job that waits for one; none if no job does. Needs the mutex that guards the ledger.
std::optional<PendingStep> NextStep(const Ledger& ledger);
// The tasks of the phase. Reads surveys from blobs, and plans: not under the core's mutex.
StatusOr<std::vector<PlannedTask>> PlanPhase(const DispatchEnvironment& environment, const PendingStep& step);
// The tasks that the phase is planned in place of. Not under the core's mutex.
std::vector<KnownTask> TasksFrom(DispatchCore& core, const PendingStep& step);
// Stores the report (kJobFile) of the job that ends. Not under the core's mutex.
StatusOr<Digest> StoreReport(DispatchCore& core, const PendingStep& step);

inline constexpr char kJobFile[] = "job.json";

}  // namespace tessera
