// NVM files.
#pragma once

#include <string>

#include "common/blocks/nvm.h"
#include "tests/fuzz/blocks/block_promises.h"

namespace tessera {

// Parses `bytes`; aborts if what comes out breaks a promise of ParseNvm. True if it was taken as a block.
inline bool RunNvmTarget(const std::string& bytes) {
  Faults faults;
  const ImportedBlock block = ParseNvm(
      bytes, "input",
      [](const std::string&) {
        return ImageSize{400, 300};
      },
      {}, &faults);
  if (!Accepted(faults)) return false;
  RequireBlock(block);
  for (const BlockReading& reading : block.readings) {
    ImportedBlock other = block;
    reading.apply(&other);
    for (const BlockCamera& camera : other.cameras) {
      for (const double c : camera.lens.coefficients) Require(std::isfinite(c), "ParseNvm's readings'");
    }
  }
  return true;
}

}  // namespace tessera
