// PLY files as tables: the points and projections of PhotoScan and Metashape.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// Reads properties of the first element of a binary little-endian PLY: a column for each of `names`, all of the same
// length. A name with "?" behind it may be missing; its column is empty then. INVALID_ARGUMENT for other PLY, lists in
// the first element, missing properties, and counts that the size of the file does not allow.
StatusOr<std::vector<std::vector<double>>> ParsePlyColumns(std::string_view bytes, const std::string& file,
                                                           const std::vector<std::string>& names);

}  // namespace tessera
