// Adjacency of a label field: the edges of each face.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "worker/label/label_field.h"

namespace tessera {

// One end of an edge: the neighbour, the weight, and the index of the edge in the field.
struct FieldLink {
  uint32_t face = 0;
  float weight = 0;
  uint32_t edge = 0;
};

struct FieldGraph {
  std::vector<uint32_t> offsets;  // faces + 1
  std::vector<FieldLink> links;   // those of face f from offsets[f], in the order of the field's edges
  std::span<const FieldLink> operator[](size_t face) const {
    return {links.data() + offsets[face], offsets[face + 1] - offsets[face]};
  }
};

// Edges of weight 0 are left out.
FieldGraph MakeFieldGraph(const LabelField& field);

}  // namespace tessera
