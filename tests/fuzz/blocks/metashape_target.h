// Metashape's XML of cameras, or a .psz.
#pragma once

#include <string>

#include "common/blocks/metashape/metashape.h"
#include "tests/fuzz/blocks/block_promises.h"

namespace tessera {

// True if it was taken as a block.
inline bool RunMetashapeTarget(const std::string& bytes) {
  Faults faults;
  Warnings warnings;
  const ImportedBlock block = ParseMetashape(bytes, "input", {}, &faults, &warnings);
  if (!Accepted(faults)) return false;
  RequireBlock(block);
  return true;
}

}  // namespace tessera
