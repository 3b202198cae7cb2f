#include "worker/label/expansion.h"

#include <span>

namespace tessera {

void BlockExpansion::Run(uint32_t block, int rounds, std::vector<int32_t>* labels) {
  labels_ = labels->data();
  block_ = block;
  const std::span<const uint32_t> faces = blocks_[block];
  const size_t count = faces.size();
  may_.assign(count, 0);
  most_.assign(count, 0);
  bound_.resize(count);
  node_.resize(count);
  for (size_t i = 0; i < count; ++i) {
    for (const UndecidedField::Link& link : field_[faces[i]]) most_[i] += link.weight;
  }
  // Once every label has had its turn in vain, so will all that follow.
  int vain = 0;
  for (int round = 0; round < rounds; ++round) {
    for (int32_t alpha = 0; alpha < field_.classes; ++alpha) {
      vain = Expand(alpha) ? 0 : vain + 1;
      if (vain == field_.classes) return;
    }
  }
}

float BlockExpansion::SwitchCost(uint32_t face, int32_t alpha) const {
  const float* cost = &field_.cost[face * field_.lanes];
  return cost[alpha] - cost[labels_[face]];
}

// What switching costs `face` on one link if whoever may have alpha at its other end has it.
float BlockExpansion::BestOnLink(uint32_t face, const UndecidedField::Link& link, int32_t alpha) const {
  const int32_t other = labels_[link.face];
  if (other == alpha || Candidate(link.face)) return -link.weight;
  return other == labels_[face] ? link.weight : 0;
}

// Marks the faces that could gain by alpha if all the others that are marked had it. No other face is in the best
// expansion.
void BlockExpansion::FindCandidates(int32_t alpha) {
  candidates_.clear();
  const std::span<const uint32_t> faces = blocks_[block_];
  for (size_t i = 0; i < faces.size(); ++i) {
    const uint32_t f = faces[i];
    may_[i] = labels_[f] != alpha && !blocks_.bridge[f] && SwitchCost(f, alpha) < most_[i];
    if (may_[i]) candidates_.push_back(f);
  }
  for (const uint32_t f : candidates_) {
    float& bound = bound_[blocks_.place[f]];
    bound = SwitchCost(f, alpha);
    for (const UndecidedField::Link& link : field_[f]) bound += BestOnLink(f, link, alpha);
  }
  out_.clear();
  for (const uint32_t f : candidates_) {
    if (bound_[blocks_.place[f]] >= 0) Exclude(f);
  }
  while (!out_.empty()) {
    const uint32_t f = out_.back();
    out_.pop_back();
    for (const UndecidedField::Link& link : field_[f]) {
      if (!Candidate(link.face)) continue;
      float& bound = bound_[blocks_.place[link.face]];
      bound += labels_[f] == labels_[link.face] ? 2 * link.weight : link.weight;
      if (bound >= 0) Exclude(link.face);
    }
  }
  std::erase_if(candidates_, [&](uint32_t f) { return !may_[blocks_.place[f]]; });
}

void BlockExpansion::Exclude(uint32_t face) {
  may_[blocks_.place[face]] = 0;
  out_.push_back(face);
}

// True if alpha took any face.
bool BlockExpansion::Expand(int32_t alpha) {
  FindCandidates(alpha);
  if (candidates_.empty()) return false;
  const int count = static_cast<int>(candidates_.size());
  cut_.Reset(count);
  for (int node = 0; node < count; ++node) node_[blocks_.place[candidates_[node]]] = node;
  for (int node = 0; node < count; ++node) {
    const uint32_t f = candidates_[node];
    double cost = SwitchCost(f, alpha);
    for (const UndecidedField::Link& link : field_[f]) {
      const bool same = labels_[f] == labels_[link.face];
      if (!Candidate(link.face)) {
        cost += labels_[link.face] == alpha ? -link.weight : same ? link.weight : 0;
        continue;
      }
      // Different labels cost w as they are and nothing once both are alpha.
      if (!same) cost -= 0.5 * link.weight;
      const int other = node_[blocks_.place[link.face]];
      if (node < other) cut_.AddPair(node, other, same ? link.weight : 0.5 * link.weight);
    }
    cut_.AddCost(node, cost);
  }
  cut_.Solve();
  bool took = false;
  for (int node = 0; node < count; ++node) {
    if (!cut_.In(node)) continue;
    labels_[candidates_[node]] = alpha;
    took = true;
  }
  return took;
}

}  // namespace tessera
