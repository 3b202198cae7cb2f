// Reduction of a label field to the faces whose label is not decided by their unary cost alone.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "worker/label/cells.h"
#include "worker/label/label_field.h"

namespace tessera {

inline constexpr int32_t kUndecided = -1;
inline constexpr int kDecideRounds = 4;

// Partial optimality: a face whose best unary cost leads by at least the total weight of its edges has that label in
// a best labelling, whatever its neighbours' labels. Its min-sum messages are then constant: 0 for its label, the
// edge's weight for all others. Folding them into the neighbours' costs may decide further faces. Runs kDecideRounds
// rounds, so that the result depends only on faces within as many rings. Returns the label of each face, or
// kUndecided.
std::vector<int32_t> DecideFaces(const LabelField& field, const FieldGraph& graph);

// The undecided faces and the edges between them. Faces are numbered by cell, and by face index within a cell, for
// memory locality. Sums over a face's links run in the order of the field's edges and do not depend on the numbering.
struct UndecidedField {
  static constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
  static constexpr int kLanes = 4;        // a face's costs are padded to a multiple of this many floats
  static constexpr float kNever = 1e30f;  // cost of the padding

  // One end of an edge: the neighbour, the index of the opposite link, and the weight.
  struct Link {
    uint32_t face = 0, reverse = 0;
    float weight = 0;
  };

  int classes = 0;
  size_t lanes = 0;               // per face
  std::vector<uint32_t> faces;    // number -> the field's face
  std::vector<uint32_t> number;   // the field's face -> number, or kNone
  std::vector<float> cost;        // faces x lanes: unary cost less the weights of edges to decided faces
  std::vector<uint32_t> offsets;  // faces + 1
  std::vector<Link> links;        // those of face i from offsets[i]

  size_t size() const { return faces.size(); }
  std::span<const Link> operator[](size_t face) const {
    return {links.data() + offsets[face], offsets[face + 1] - offsets[face]};
  }
};

UndecidedField MakeUndecidedField(const LabelField& field, const FieldGraph& graph,
                                  const std::vector<int32_t>& decided);

// The undecided faces grouped into blocks of cells; one block if the field has no cells.
struct Blocks {
  std::vector<uint32_t> block;           // of each number
  std::vector<uint32_t> index_in_block;  // of each number within its block
  std::vector<uint32_t> offsets;         // blocks + 1
  std::vector<uint32_t> faces;           // numbers of block b from offsets[b], ascending by the field's face
  std::array<std::vector<uint32_t>, kColours> colours;  // blocks of each colour
  // Flags of numbers with a link to a different block of the same colour (only large faces have one). Bridges keep
  // their labels, so that no two faces that change in blocks of one colour are linked.
  std::vector<uint8_t> bridge;

  size_t size() const { return offsets.size() - 1; }
  std::span<const uint32_t> operator[](size_t b) const {
    return {faces.data() + offsets[b], offsets[b + 1] - offsets[b]};
  }
};

Blocks MakeBlocks(const LabelField& field, const UndecidedField& undecided, BlockGrid grid);

}  // namespace tessera
