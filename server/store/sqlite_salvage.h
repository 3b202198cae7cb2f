// Recovers the readable records of a damaged store.
#pragma once

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "server/store/record_store.h"

namespace tessera {

struct Salvaged {
  int64_t records = 0;
  int64_t last = 0;     // number of the last record
  std::string damaged;  // new path of the damaged file
};

// Replaces the database at `path` by a new one with every readable record; the damaged file is kept under another name.
// Missing records are reported when the store is opened. The database must not be in use. On error it is unchanged.
StatusOr<Salvaged> Salvage(const std::string& path, const OwnerOf& owner_of);

}  // namespace tessera
