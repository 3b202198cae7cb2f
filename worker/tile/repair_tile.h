// Taking back the motion of a tile's vertices where faces folded or cut each other.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "common/base/status.h"
#include "worker/refine/stepper.h"
#include "worker/tile/methods.h"
#include "worker/tile/tile_workspace.h"

namespace tessera {

struct CoreRepair {
  int64_t changed_vertices = 0;  // as SurfaceRepair::Result has them, some of other tiles among them
  int64_t left_faces = 0;        // of the core: still spoiled
};

// Which motion is repaired.
enum class RepairStage {
  kStart,         // before the first iteration: the start is unfolded (MotionGuard::RepairedStart)
  kRevisedStart,  // the same where an update has another mesh: the base's result counts as motion from the start
  kLevel,         // after the last iteration of a level: motion since the level's start
};

// Repairs the positions of `snapshot`, right for the core, and ends the level: level_start and last_step become empty.
// Faces that no label step has reached yet get the confidence of carried labels. DATA_LOSS if kLevel has no
// level_start.
StatusOr<CoreRepair> Repair(TileWorkspace& work, RepairStage stage, const TileRefineOptions& options,
                            TileSnapshot* snapshot);

// SurfaceRepair of `region`, of which `core` are flags of its faces: the core's `positions` become those that a repair
// of the whole region gives. Reads only the faces that a pass can reach: those whose boxes about `good` and `positions`
// touch.
CoreRepair RepairCore(const RegionMesh& region, const std::vector<uint8_t>& core, double gsd_m,
                      const StepperOptions& options, const std::vector<Eigen::Vector3d>& good,
                      std::vector<Eigen::Vector3d>* positions);

// The same with the kept guard and boxes of the region.
CoreRepair RepairWithKept(RegionRepair& kept, const RegionMesh& region, const std::vector<uint8_t>& core,
                          const StepperOptions& options, const std::vector<Eigen::Vector3d>& good,
                          std::vector<Eigen::Vector3d>* positions);

// Confidence of a label that is carried through, because no likelihoods can change it.
float CarriedConfidence(int classes, int32_t label);
// Fills TileSnapshot::confidence with it where that is empty.
void FillConfidence(const TilePackage& package, TileSnapshot* snapshot);

}  // namespace tessera
