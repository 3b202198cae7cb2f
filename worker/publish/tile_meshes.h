// Exports the result as one PLY per tile with an index.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "worker/city/city_file.h"
#include "worker/publish/merge_cores.h"

namespace tessera {

// File name of a tile's mesh, by the first cell of its core: "tiles/12_-3.ply".
std::string TileMeshName(const CellRect& core);

// Writes TileMeshName for each core (`cores[i]` belongs to `tiles[i]`) and kTileIndexFile to `output_dir`, and
// returns the file names.
// Meshes are in the scene's frame, with the properties of mesh.ply except `input_face` and `outdated`, so that a tile
// that an update does not change has the same bytes. Vertices shared by tiles are equal byte for byte.
// The index contains per file: core (cells and metres of the ground plane), box (scene's frame), vertices, faces,
// faces per class and, unless `outdated` (ids, ascending) is empty, the number of outdated faces. Tiles of
// `quarantined` (ids of quarantined tiles, ascending) are flagged.
// Memory is bounded by one tile. DATA_LOSS if a core differs from the city in its rectangle.
StatusOr<std::vector<std::string>> WriteTileMeshes(const std::string& output_dir, const CityReader& city,
                                                   const Survey& survey, const std::vector<TileParameters>& tiles,
                                                   const std::vector<CoreSpans>& cores,
                                                   std::span<const uint32_t> outdated,
                                                   const std::vector<int>& quarantined, const TaskControl& control);

}  // namespace tessera
