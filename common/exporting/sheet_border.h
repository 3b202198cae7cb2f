// Which vertices of a sheet may also be in other sheets.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/geometry/mesh.h"

namespace tessera {

// Per vertex: 1 if its faces do not surround it, so that it lies on the border of the sheet or of the city; also 1 if
// it has no face. The faces are indices below `vertices`.
std::vector<uint8_t> BorderVertices(size_t vertices, std::span<const Triangle> faces);

}  // namespace tessera
