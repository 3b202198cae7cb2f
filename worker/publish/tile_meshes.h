// The result in pieces that any program can open: a PLY a tile, and an index of them.
#ifndef TESSERA_WORKER_PUBLISH_TILE_MESHES_H_
#define TESSERA_WORKER_PUBLISH_TILE_MESHES_H_

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

// Name of a tile's mesh: the first cell of its core, "tiles/12_-3.ply".
std::string TileMeshName(const CellRect& core);

// Writes TileMeshName for each core (`cores[i]` is that of `tiles[i]`) and kTileIndexFile to `output_dir`: scene's
// frame, with the properties of mesh.ply but `input_face` and `outdated`, so that a tile that an update keeps has the
// same bytes; vertices that tiles share are equal byte for byte. The index names each file with its core (cells and
// metres of the ground plane), box (scene's frame), vertices, faces, faces a class and, unless `outdated` (ids,
// ascending) is empty, how many of its faces are among those; those of
// `set_aside` (ids of tiles, ascending), whose refinement failed, are flagged. Gives the files' names. Memory is
// bounded by a tile. DATA_LOSS if a core is not what the city has in its rectangle.
StatusOr<std::vector<std::string>> WriteTileMeshes(const std::string& output_dir, const CityReader& city,
                                                   const Survey& survey, const std::vector<TileParameters>& tiles,
                                                   const std::vector<CoreSpans>& cores,
                                                   std::span<const uint32_t> outdated,
                                                   const std::vector<int>& set_aside, const TaskControl& control);

}  // namespace tessera

#endif  // TESSERA_WORKER_PUBLISH_TILE_MESHES_H_
