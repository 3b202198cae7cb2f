// The steps of a tile's refinement, as its tasks do them one by one, and all of them for a job's only tile.
#ifndef TESSERA_WORKER_TILE_REFINE_TILE_H_
#define TESSERA_WORKER_TILE_REFINE_TILE_H_

#include <memory>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/base/task_control.h"
#include "worker/label/unary.h"
#include "worker/tile/tile_files.h"
#include "worker/tile/tile_options.h"
#include "worker/tile/tile_views.h"
#include "worker/tile/tile_workspace.h"

namespace tessera {

// What the views say of the package's faces where they lie; right for those with a flag in `own`. CANCELLED follows
// `control`.
StatusOr<FaceLikelihoods> SumLikelihoods(const TilePackage& package, const std::vector<uint8_t>& own,
                                         const std::vector<Eigen::Vector3d>& positions,
                                         const std::vector<TileView>& views, const ViewGroups& groups,
                                         const TaskControl& control);

// Labels of a region's faces from what the views say of them. `confidence`: 0 where they say nothing. `frozen`: flags
// of faces that keep the label of `start`; empty: none.
struct RegionLabels {
  std::vector<int32_t> labels;
  std::vector<float> confidence;
  double start_energy = 0, energy = 0;  // of the region
};
RegionLabels LabelRegion(const TilePackage& package, const RegionMesh& region,
                         const std::vector<Eigen::Vector3d>& positions, const std::vector<int32_t>& start,
                         const FaceLikelihoods& sums, const TileRefineOptions& options,
                         const std::vector<uint8_t>& frozen = {});

// Confidence of labels that are carried through: nothing speaks against them.
float CarriedConfidence(int classes, int32_t label);

struct TileRefinement {
  TileState state;
  int64_t left_faces = 0;  // as RefineReport has them, of all rounds
  double seconds_prepare = 0, seconds_visibility = 0, seconds_data = 0, seconds_step = 0, seconds_repair = 0,
         seconds_labels = 0;
};

// All steps of a package that holds the whole city: the bytes that the steps give tile by tile. `views` as
// OpenTileViews gives them. Without likelihoods labels are carried through; with fewer than two views the geometry
// stays. CANCELLED follows `control`.
StatusOr<TileRefinement> RefineTile(TileWorkspace& work, const std::vector<TileView>& views,
                                    const TileRefineOptions& options, const TaskControl& control, const Clock& clock);

}  // namespace tessera

#endif  // TESSERA_WORKER_TILE_REFINE_TILE_H_
