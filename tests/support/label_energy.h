// The energy that labelling minimises.
#pragma once

#include <cstdint>
#include <vector>

#include "worker/label/label_field.h"

namespace tessera {

// E of a labelling (LabelField), every label in [0, classes).
inline double LabelEnergy(const LabelField& field, const std::vector<int32_t>& labels) {
  double energy = 0;
  for (size_t f = 0; f < labels.size(); ++f) energy += field.unary[f * field.classes + labels[f]];
  for (const FieldEdge& edge : field.edges) {
    if (labels[edge.face0] != labels[edge.face1]) energy += edge.weight;
  }
  return energy;
}

}  // namespace tessera
