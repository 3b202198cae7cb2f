// Scenes in OpenMVS's interface format.
#pragma once

#include <string>

#include "common/blocks/openmvs.h"
#include "tests/fuzz/blocks/block_promises.h"

namespace tessera {

inline bool RunOpenMvsTarget(const std::string& bytes) {
  Faults faults;
  const auto image_size = [](const std::string& name) -> StatusOr<ImageSize> {
    if (name.size() % 5 == 4) return absl::NotFoundError("no file of this name");
    return ImageSize{400, 300};
  };
  const ImportedBlock block = ParseOpenMvs(bytes, "input", image_size, &faults);
  if (!Accepted(faults)) return false;
  RequireBlock(block);
  return true;
}

}  // namespace tessera
