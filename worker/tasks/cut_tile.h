// Taking a tile out of the city.
#ifndef TESSERA_WORKER_TASKS_CUT_TILE_H_
#define TESSERA_WORKER_TASKS_CUT_TILE_H_

#include "common/base/status.h"
#include "common/tile/survey.h"
#include "common/tile/task_parameters.h"
#include "worker/tasks/city_file.h"
#include "worker/tasks/occluders.h"
#include "worker/tasks/tile_files.h"

namespace tessera {

// The faces whose centroid lies in the core (by cell) or at most parameters.halo_m from it, with everything else that
// may hide them from the tile's views as occluders. Reads the blocks of the city that these lie in or touch, and no
// others. INVALID_ARGUMENT for a core without faces; errors as CityReader::Block's.
StatusOr<TilePackage> CutTile(const CityReader& city, const Survey& survey, const CutParameters& parameters,
                              const OccluderOptions& occluders = {});

}  // namespace tessera

#endif  // TESSERA_WORKER_TASKS_CUT_TILE_H_
