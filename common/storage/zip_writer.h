// Writes zip archives.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// Writes the files `members`, paths relative to `folder`, in this order to an archive, without compression. The archive
// depends on the names and contents alone: it has no times. It appears at `path` only when it is complete. Errors of
// the files; RESOURCE_EXHAUSTED if the disk is full.
Status WriteStoredZip(const std::string& path, const std::string& folder, const std::vector<std::string>& members);

}  // namespace tessera
