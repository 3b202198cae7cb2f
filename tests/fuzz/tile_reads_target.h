// reads.json, which workers write and the coordinator plans by.
#pragma once

#include <string>

#include "common/job/task_parameters.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// True if it was taken as what tile 3 of 8 reads.
inline bool RunTileReadsTarget(const std::string& bytes) {
  const StatusOr<TileReads> reads = ParseTileReads(bytes, 3, 8);
  if (!reads.ok()) {
    RequireRefusal(reads.status());
    return false;
  }
  Require(ToJson(*reads) == bytes, "nothing is taken but what is written");
  return true;
}

}  // namespace tessera
