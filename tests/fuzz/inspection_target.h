// What inspect tasks write of pixel files.
#pragma once

#include <string>

#include "common/check/inspection.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// True if it was taken.
inline bool RunInspectionTarget(const std::string& bytes) {
  Inspections inspections;
  const Status status = inspections.Add(bytes, "/scene");
  if (!status.ok()) {
    RequireRefusal(status);
    return false;
  }
  SceneLoadOptions load;
  inspections.AddTo(&load);
  for (const auto& [path, content] : inspections.label_contents()) {
    Require(load.elsewhere.contains(path), "each file is known");
  }
  return true;
}

}  // namespace tessera
