// What is left of a label field once the faces are decided whose label is plain.
#ifndef TESSERA_WORKER_LABEL_UNDECIDED_FIELD_H_
#define TESSERA_WORKER_LABEL_UNDECIDED_FIELD_H_

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "worker/label/cells.h"
#include "worker/label/field_graph.h"

namespace tessera {

inline constexpr int32_t kUndecided = -1;
inline constexpr int kDecideRounds = 4;

// A face whose own cost leads by no less than all its edges weigh has the same label in a best labelling whatever the
// others have, and its min-sum messages say so from the first to the last round: nothing for its label, the edge's
// weight for all others. With these added to the costs of its neighbours, more faces lead. kDecideRounds rounds of
// that, so that nothing counts but what is within as many rings. The label of each face, or kUndecided.
std::vector<int32_t> DecideFaces(const LabelField& field, const FieldGraph& graph);

// The undecided faces and their edges among each other, numbered cell by cell and by face within a cell, so that
// neighbours are near in memory. Sums over a face's links run in the order of the field's edges, so the numbering does
// not change them.
struct UndecidedField {
  static constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
  static constexpr int kLanes = 4;        // costs of a face are padded to a multiple of so many floats
  static constexpr float kNever = 1e30f;  // what the padding costs

  // One end of an edge: what it leads to, the link of the same edge there, and its weight.
  struct Link {
    uint32_t face = 0, reverse = 0;
    float weight = 0;
  };

  int classes = 0;
  size_t lanes = 0;              // of a face
  std::vector<uint32_t> faces;   // number -> the field's face
  std::vector<uint32_t> number;  // the field's face -> number, or kNone
  std::vector<float> cost;  // faces x lanes: the face's own, less the weight of the edges to decided faces of a class
  std::vector<uint32_t> offsets;  // faces + 1
  std::vector<Link> links;        // those of a face from offsets[face]

  size_t size() const { return faces.size(); }
  std::span<const Link> operator[](size_t face) const {
    return {links.data() + offsets[face], offsets[face + 1] - offsets[face]};
  }
};

UndecidedField MakeUndecidedField(const LabelField& field, const FieldGraph& graph,
                                  const std::vector<int32_t>& decided);

// The undecided faces by blocks of their cells; all in one block if the field has no cells.
struct Blocks {
  std::vector<uint32_t> block;                   // of each number
  std::vector<uint32_t> place;                   // of each number among the faces of its block
  std::vector<uint32_t> offsets;                 // blocks + 1
  std::vector<uint32_t> faces;                   // numbers of block b from offsets[b], ascending by the field's face
  std::array<std::vector<uint32_t>, 4> colours;  // blocks of each colour
  // Numbers with a link to another block of their own block's colour: only large faces have one. While these stay as
  // they are, no two faces that change in blocks of one colour are linked.
  std::vector<uint8_t> bridge;

  size_t size() const { return offsets.size() - 1; }
  std::span<const uint32_t> operator[](size_t b) const {
    return {faces.data() + offsets[b], offsets[b + 1] - offsets[b]};
  }
};

Blocks MakeBlocks(const LabelField& field, const UndecidedField& undecided, BlockGrid grid);

}  // namespace tessera

#endif  // TESSERA_WORKER_LABEL_UNDECIDED_FIELD_H_
