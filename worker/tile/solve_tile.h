// The vertices or labels of a tile after one step, from the sums over the pixels.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "common/base/status.h"
#include "worker/label/unary.h"
#include "worker/tile/measure_tile.h"
#include "worker/tile/methods.h"
#include "worker/tile/tile_files.h"
#include "worker/tile/tile_workspace.h"

namespace tessera {

// The sums of the faces of at.region(), from the tiles that have them. DATA_LOSS if a face has none.
StatusOr<StepSums> AssembleSums(TileWorkspace& work, const SumsOfTiles& tiles, const TileStep& at,
                                const TileSnapshot& snapshot);

// Takes the step: moves the vertices of at.region() or solves its labels, and adds energies and counts to the report of
// `snapshot`. `sums`: an entry for each face of the region, in its order. Exact for the core only. No vertex moves
// unless package.has_pairs, because smoothness would act alone. `work` keeps its cached stepper.
void Solve(TileWorkspace& work, const TileStep& at, const StepSums& sums, const TileRefineOptions& options,
           TileSnapshot* snapshot);

// Labels of a region's faces. `positions`, `start` and `sums`: of the region, `start` its labels before. `confidence`
// is 0 where no pixel shows the face. `frozen`: flags of faces that keep the label of `start`; empty: none.
struct RegionLabels {
  std::vector<int32_t> labels;
  std::vector<float> confidence;
};
RegionLabels LabelRegion(const TilePackage& package, const RegionMesh& region,
                         const std::vector<Eigen::Vector3d>& positions, const std::vector<int32_t>& start,
                         const FaceLikelihoods& sums, const TileRefineOptions& options,
                         const std::vector<uint8_t>& frozen = {});

}  // namespace tessera
