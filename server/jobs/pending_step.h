// The next step of a job in the coordinator: plan a phase, quarantine a tile, or end the job.
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
  int tasks = 0;  // tasks before the planned phase; if this changes, the plan is stale
  JobSettings settings;
  std::vector<NamedDigest> scene_files;
  std::optional<StatusOr<UpdateBase>> base;  // of an update
  int inspections = 0;                       // inspect tasks
  StatusOr<Digest> survey = absl::UnknownError("not read");
  // Of a job that splits faces twice, once they are: the task, its survey and its first cut (-1: none yet).
  int split = -1, first_fine_cut = -1;
  std::map<int, TaskId> coarse_crops;  // by tile: the task of the coarse part with its crops
  StatusOr<Digest> fine_survey = absl::UnknownError("not read");
  std::vector<std::pair<int, StatusOr<Digest>>> reads;  // kReadsFile of each cut tile
  int tiles = 0;                                        // highest tile with a planned cut, plus 1
  std::vector<FailedTile> quarantined;
  int replaces_from = -1;            // first task that the new plan replaces; -1: none
  int failed = -1;                   // task whose tile to quarantine
  JobState end = JobState::kFailed;  // final state, for kEnd
  std::string error;                 // for kEnd
  int64_t end_us = 0;                // for kEnd
  std::map<int, std::string> why_quarantined;
  JobHeader header;
  std::vector<NamedDigest> artifacts;
};

// The step of the oldest job that has one; none if no job has. Needs the core's mutex.
std::optional<PendingStep> NextStep(const Ledger& ledger);
// Plans the tasks of the phase. Errors of the planner and of reading blobs. Call without the core's mutex.
StatusOr<std::vector<PlannedTask>> PlanPhase(const DispatchEnvironment& environment, const PendingStep& step);
// The tasks that the new plan replaces. Call without the core's mutex.
std::vector<KnownTask> TasksFrom(DispatchCore& core, const PendingStep& step);
// Stores the report (kJobFile) of the job. Call without the core's mutex.
StatusOr<Digest> StoreReport(DispatchCore& core, const PendingStep& step);

inline constexpr char kJobFile[] = "job.json";

}  // namespace tessera
