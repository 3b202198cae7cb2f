// Flips edges of the final mesh (FlipEdges) tile by tile, before publishing.
#pragma once

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

// The city's faces in the core's rectangle, with the start's positions. Face indices refer to the core's vertices.
// DATA_LOSS if the core has other faces or vertices.
StatusOr<CollectedFaces> FacesOfCore(const CityReader& city, const GroundPlane& ground, const CellRect& rect,
                                     const CoreSpans& core);

// Flips edges of all cores except those of `quarantined` (ids of quarantined tiles, ascending) and sets
// CoreSpans::flipped, which refers to the returned array. Edges are flipped per ground cell, so the result depends
// neither on the tiling nor on other tiles' results. `cores[i]` belongs to `tiles[i]`. `folder` temporarily takes 16
// bytes per flipped face; memory is bounded by one tile. Errors as FacesOfCore.
StatusOr<ScratchArray<FlippedFace>> FlipCores(const CityReader& city, const GroundPlane& ground,
                                              const std::vector<TileParameters>& tiles,
                                              const std::vector<int>& quarantined, const std::string& folder,
                                              const TaskControl& control, std::vector<CoreSpans>* cores);

}  // namespace tessera
