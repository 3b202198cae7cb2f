// The settings of a tile's refinement.
#ifndef TESSERA_WORKER_TILE_TILE_OPTIONS_H_
#define TESSERA_WORKER_TILE_TILE_OPTIONS_H_

#include "worker/label/belief_propagation.h"
#include "worker/label/label_field.h"
#include "worker/refine/refine.h"
#include "worker/tile/tile_files.h"

namespace tessera {

struct TileRefineOptions {
  int rounds = 1;                     // of geometry, then labels; always all of them, so that tiles do alike
  bool labels_first = false;          // before the first geometry
  bool geometry_knows_labels = true;  // false: the geometry sees a mesh without labels
  RefineOptions geometry;
  LabelOptions label;
  SolverOptions solver;
};

// What the options come to with these classes: one class is no class, what it could say is the same everywhere.
inline bool GeometryKnowsLabels(const TilePackage& package, const TileRefineOptions& options) {
  return options.geometry_knows_labels && package.classes.size() > 1;
}
inline bool LabelsChange(const TilePackage& package) { return package.has_likelihoods && package.classes.size() > 1; }

}  // namespace tessera

#endif  // TESSERA_WORKER_TILE_TILE_OPTIONS_H_
