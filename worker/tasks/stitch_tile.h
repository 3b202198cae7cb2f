// Blending a tile's core with the tiles that reach into it.
#ifndef TESSERA_WORKER_TASKS_STITCH_TILE_H_
#define TESSERA_WORKER_TASKS_STITCH_TILE_H_

#include <vector>

#include "common/base/status.h"
#include "common/tile/task_parameters.h"
#include "worker/tasks/tile_files.h"

namespace tessera {

// A vertex moves by Σ w_t d_t / Σ w_t over the tiles that have it (TileBlend), so both sides of a seam compute the same
// bytes. A face's label is the best of its beliefs, blended alike. `results`: of the last steps, one for each of
// parameters.results, in that order. DATA_LOSS if a result does not fit.
StatusOr<TileCore> StitchTile(const TilePackage& package, const std::vector<TileResult>& results,
                              const StitchParameters& parameters);

}  // namespace tessera

#endif  // TESSERA_WORKER_TASKS_STITCH_TILE_H_
