// States and sums of tiles that recent tasks of this process have read. Several tiles of a worker read the same ones:
// each is mapped, compared with its checksums and converted once. Functions are thread-safe.
#pragma once

#include <memory>
#include <string>

#include "common/base/status.h"
#include "worker/tile/tile_files.h"

namespace tessera {

// Identifies the content of the file at `path` (links are followed). Blobs are never changed in place. NOT_FOUND if it
// does not exist.
StatusOr<std::string> ContentKey(const std::string& path);

// The state or the sums at `path`, read now or by an earlier task. Of each tile the last that was read is kept, within
// a 64th of the memory and 256 MiB for states, and as much for sums. Errors as MappedState::Open and ReadTileSums.
StatusOr<std::shared_ptr<const MappedState>> OpenState(const std::string& path);
StatusOr<std::shared_ptr<const TileSums>> OpenSums(const std::string& path);

}  // namespace tessera
