// What is left of a label field once the faces are decided whose label is plain.
#ifndef TESSERA_WORKER_LABEL_OPEN_FIELD_H_
#define TESSERA_WORKER_LABEL_OPEN_FIELD_H_

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "worker/label/field_graph.h"

namespace tessera {

inline constexpr int32_t kUndecided = -1;

// A face whose own cost leads by no less than all its edges weigh has the same label in a best labelling whatever the
// others have, and its min-sum messages say so from the first to the last round: nothing for its label, the edge's
// weight for all others. With these added to the costs of its neighbours, more faces lead. A fixed number of rounds of
// that, so that only a face's surroundings count. The label of each face, or kUndecided.
std::vector<int32_t> DecideFaces(const LabelField& field, const FieldGraph& graph);

// The undecided faces and their edges among each other, numbered so that neighbours are near in memory. Sums over a
// face's links run in the order of the field's edges, so the numbering does not change them.
struct OpenField {
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

OpenField MakeOpenField(const LabelField& field, const FieldGraph& graph, const std::vector<int32_t>& decided);

}  // namespace tessera

#endif  // TESSERA_WORKER_LABEL_OPEN_FIELD_H_
