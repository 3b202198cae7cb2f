// Lineage of tiles as text and as JSON.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/client/lineage.h"

namespace tessera {

// Why a tile was refined again: "image seen: 4 (new/0001.jpg, ...)".
std::string ReasonText(const std::string& reason, const std::vector<std::string>& images);

// One line per tile. Dates are UTC.
std::string LineageTable(const Lineage& lineage);

// One tile with the action of each job of the chain. `with_images`: also its image names, one per line.
// INVALID_ARGUMENT if the job has no such tile.
StatusOr<std::string> TileLineageText(const Lineage& lineage, int tile, bool with_images);

// {"tessera_lineage", "job", "chain": [jobs], "tiles": [...]}: tiles with their images by flight and their history.
// `tile`: only this tile, if not negative; INVALID_ARGUMENT if there is no such tile.
StatusOr<std::string> LineageJson(const Lineage& lineage, int tile);

}  // namespace tessera
