// Min-sum message passing on a label field.
#pragma once

#include <vector>

#include "worker/label/undecided_field.h"

namespace tessera {

struct Messages {
  std::vector<float> incoming;  // links x lanes: message to a link's face from its neighbour
  std::vector<float> beliefs;   // faces x lanes: a face's cost plus all incoming messages
};

// The state before the first iteration: all messages are 0.
Messages InitialMessages(const UndecidedField& undecided);

// Runs `iterations` synchronous iterations: every face sends to every neighbour at once. `damping`: weight of the old
// message in the new one. Deterministic for any number of threads.
void PassMessages(const UndecidedField& undecided, int iterations, double damping, Messages* messages);

// Beliefs of all faces of the whole field (faces x classes): the approximate cost of each label with all other faces
// at their best, up to a constant per face.
std::vector<float> FaceBeliefs(const LabelField& field, const FieldGraph& graph, const std::vector<int32_t>& decided,
                               const UndecidedField& undecided, const Messages& messages);

}  // namespace tessera
