// FoldRepair on as little of a region as it reads.
#ifndef TESSERA_WORKER_TILE_REPAIR_CORE_H_
#define TESSERA_WORKER_TILE_REPAIR_CORE_H_

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "worker/refine/stepper.h"
#include "worker/tile/tile_workspace.h"

namespace tessera {

struct CoreRepair {
  int64_t changed_vertices = 0;  // as FoldRepair::Result has them, some of other tiles among them
  int64_t left_faces = 0;        // of the core
};

// Stepper::Repair of `region`, of which `core` are flags of its faces: the core's `positions` become those that the
// whole region gives. What a pass reads lies where faces' boxes about `good` and `positions` touch, and that is known
// here, while the region has what may touch at all.
CoreRepair RepairCore(const RegionMesh& region, const std::vector<uint8_t>& core, double gsd_m,
                      const StepperOptions& options, const std::vector<Eigen::Vector3d>& good,
                      std::vector<Eigen::Vector3d>* positions);

}  // namespace tessera

#endif  // TESSERA_WORKER_TILE_REPAIR_CORE_H_
