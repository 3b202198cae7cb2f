// Inputs and warnings that several tasks of a tile share: refine, measure, solve and repair.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/task_parameters.h"
#include "worker/tasks/task.h"
#include "worker/tile/methods.h"
#include "worker/tile/tile_workspace.h"

namespace tessera {

struct StepTask {
  StepParameters parameters;
  std::shared_ptr<TileWorkspace> work;
  TileRefineOptions options;
  TileStep at;
  TileSnapshot snapshot;   // as TileWorkspace::Assemble gives it
  std::string states_key;  // of the states of `snapshot`, for KeptSnapshot
};

// Reads the package and the states among the inputs. The states must cover a region of the package, `label_region` in
// label steps and `iteration_region` in iterations; 0: nothing is required. Errors as those of the files;
// INVALID_ARGUMENT for parameters that do not fit.
StatusOr<StepTask> OpenStepTask(const TaskRequest& request, uint8_t label_region, uint8_t iteration_region);

// Paths of the tile's crops among the inputs; in the fine part of a job (JobPart), then those of the coarse part.
std::vector<std::string> CropsOf(const TaskRequest& request, int tile);

// Adds the differences that Assemble counted to the report of the snapshot.
void CountSeams(TileSnapshot* snapshot);

// Compares the tile's sample with what the faces' own tile measured, and adds it to what Assemble compared. `sums`: of
// the tile and those that it reads.
void CompareSample(const TilePackage& package, const SumsOfTiles& sums, TileSnapshot* snapshot);

// A warning if tiles differ: vertices and faces that several tiles compute must be equal.
Warnings SeamWarnings(int tile, const TileSnapshot& snapshot);

// A warning for faces that cut each other or turned against the start and could not be repaired.
std::string FoldWarning(int tile, int64_t faces);

// Of parameters.sums.
StatusOr<SumsOfTiles> OpenSumsOf(const TaskRequest& request, const StepParameters& parameters);

}  // namespace tessera
