// The faces whose edges are flipped before the mesh is published (FlipEdges), tile by tile.
#ifndef TESSERA_WORKER_PUBLISH_FLIPPED_FACES_H_
#define TESSERA_WORKER_PUBLISH_FLIPPED_FACES_H_

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/job/ground.h"
#include "common/job/task_parameters.h"
#include "common/storage/mapped_file.h"
#include "worker/city/city_file.h"
#include "worker/city/collected_faces.h"
#include "worker/publish/merge_cores.h"

namespace tessera {

// The city's faces in the core's rectangle, as the start has them; then faces name the core's vertices by their place
// in it. DATA_LOSS if the core has others.
StatusOr<CollectedFaces> FacesOfCore(const CityReader& city, const GroundPlane& ground, const CellRect& rect,
                                     const CoreSpans& core);

// Flips edges of all cores but those in `set_aside` (ids of tiles, ascending) and sets CoreSpans::flipped, which points
// into what is returned. Ground cells are the groups, so the result depends neither on the tiling nor on what other
// tiles became. `cores[i]` is that of `tiles[i]`. `folder` takes 16 bytes a flipped face meanwhile; memory is bounded
// by a tile. Errors as FacesOfCore's.
StatusOr<ScratchArray<FlippedFace>> FlipCores(const CityReader& city, const GroundPlane& ground,
                                              const std::vector<TileParameters>& tiles,
                                              const std::vector<int>& set_aside, const std::string& folder,
                                              const TaskControl& control, std::vector<CoreSpans>* cores);

}  // namespace tessera

#endif  // TESSERA_WORKER_PUBLISH_FLIPPED_FACES_H_
