// Where tiles come from, for people and as JSON.
#ifndef TESSERA_SERVER_DISPLAY_LINEAGE_TEXT_H_
#define TESSERA_SERVER_DISPLAY_LINEAGE_TEXT_H_

#include <string>

#include "common/base/status.h"
#include "server/client/lineage.h"

namespace tessera {

// A line a tile. Dates are of UTC.
std::string LineageTable(const Lineage& lineage);

// All of one tile, with what each job of the chain did about it; `with_images`: the names of its images, a line each.
// INVALID_ARGUMENT if the job has no such tile.
StatusOr<std::string> TileLineageText(const Lineage& lineage, int tile, bool with_images);

// {"tessera_lineage", "job", "chain": [jobs], "tiles": [...]}: the tiles with their images by flight and their history.
// `tile`: only this one, if it is not negative (INVALID_ARGUMENT if there is no such tile).
StatusOr<std::string> LineageJson(const Lineage& lineage, int tile);

}  // namespace tessera

#endif  // TESSERA_SERVER_DISPLAY_LINEAGE_TEXT_H_
