// metadata.xml of ContextCapture.
#pragma once

#include <string>

#include "common/importing/mesh_source.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// Parses `bytes`; aborts if what comes out breaks a promise of ParseModelMetadata. True if it was taken.
inline bool RunModelMetadataTarget(const std::string& bytes) {
  const StatusOr<ModelMetadata> metadata = ParseModelMetadata(bytes, "input");
  if (!metadata.ok()) {
    RequireRefusal(metadata.status());
    return false;
  }
  Require(metadata->origin.allFinite() && metadata->crs.size() <= bytes.size(), "ParseModelMetadata's");
  return true;
}

}  // namespace tessera
