// The settings of a tile's refinement.
#pragma once

#include "worker/label/belief_propagation.h"
#include "worker/label/label_field.h"
#include "worker/photo/data_term.h"
#include "worker/refine/stepper.h"
#include "worker/tile/tile_files.h"

namespace tessera {

struct TileRefineOptions {
  bool geometry_uses_labels = true;  // false: iterations see a mesh without labels
  DataOptions data;
  StepperOptions step;
  LabelOptions label;
  SolverOptions solver;
};

// Whether iterations use labels. With one class alone labels say nothing.
inline bool GeometryUsesLabels(const TilePackage& package, const TileRefineOptions& options) {
  return options.geometry_uses_labels && package.classes.size() > 1;
}

}  // namespace tessera
