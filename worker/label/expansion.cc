#include "worker/label/expansion.h"

#include <span>

namespace tessera {

void BlockExpansion::Run(uint32_t block, int rounds, std::vector<int32_t>* labels) {
  labels_ = labels->data();
  block_ = block;
  const std::span<const uint32_t> faces = blocks_[block];
  const size_t count = faces.size();
  is_candidate_.assign(count, 0);
  link_weight_.assign(count, 0);
  bound_.resize(count);
  node_.resize(count);
  for (size_t i = 0; i < count; ++i) {
    for (const UndecidedField::Link& link : field_[faces[i]]) link_weight_[i] += link.weight;
  }
  // Stop when no label of a full cycle has changed anything: later moves cannot either.
  int unchanged = 0;
  for (int round = 0; round < rounds; ++round) {
    for (int32_t alpha = 0; alpha < field_.classes; ++alpha) {
      unchanged = Expand(alpha) ? 0 : unchanged + 1;
      if (unchanged == field_.classes) return;
    }
  }
}

float BlockExpansion::SwitchCost(uint32_t face, int32_t alpha) const {
  const float* cost = &field_.cost[face * field_.lanes];
  return cost[alpha] - cost[labels_[face]];
}

// Least change of the cost of one link when `face` switches to alpha, assuming that every candidate at the other end
// switches too.
float BlockExpansion::BestOnLink(uint32_t face, const UndecidedField::Link& link, int32_t alpha) const {
  const int32_t other = labels_[link.face];
  if (other == alpha || IsCandidate(link.face)) return -link.weight;
  return other == labels_[face] ? link.weight : 0;
}

// Marks the faces that may gain from alpha if all other marked faces switch as well. All faces of the best expansion
// are among them.
void BlockExpansion::FindCandidates(int32_t alpha) {
  candidates_.clear();
  const std::span<const uint32_t> faces = blocks_[block_];
  for (size_t i = 0; i < faces.size(); ++i) {
    const uint32_t f = faces[i];
    is_candidate_[i] = labels_[f] != alpha && !blocks_.bridge[f] && SwitchCost(f, alpha) < link_weight_[i];
    if (is_candidate_[i]) candidates_.push_back(f);
  }
  for (const uint32_t f : candidates_) {
    float& bound = bound_[blocks_.index_in_block[f]];
    bound = SwitchCost(f, alpha);
    for (const UndecidedField::Link& link : field_[f]) bound += BestOnLink(f, link, alpha);
  }
  excluded_.clear();
  for (const uint32_t f : candidates_) {
    if (bound_[blocks_.index_in_block[f]] >= 0) Exclude(f);
  }
  while (!excluded_.empty()) {
    const uint32_t f = excluded_.back();
    excluded_.pop_back();
    for (const UndecidedField::Link& link : field_[f]) {
      if (!IsCandidate(link.face)) continue;
      float& bound = bound_[blocks_.index_in_block[link.face]];
      bound += labels_[f] == labels_[link.face] ? 2 * link.weight : link.weight;
      if (bound >= 0) Exclude(link.face);
    }
  }
  std::erase_if(candidates_, [&](uint32_t f) { return !is_candidate_[blocks_.index_in_block[f]]; });
}

void BlockExpansion::Exclude(uint32_t face) {
  is_candidate_[blocks_.index_in_block[face]] = 0;
  excluded_.push_back(face);
}

// Returns true if any face switched to alpha.
bool BlockExpansion::Expand(int32_t alpha) {
  FindCandidates(alpha);
  if (candidates_.empty()) return false;
  const int count = static_cast<int>(candidates_.size());
  cut_.Reset(count);
  for (int node = 0; node < count; ++node) node_[blocks_.index_in_block[candidates_[node]]] = node;
  for (int node = 0; node < count; ++node) {
    const uint32_t f = candidates_[node];
    double cost = SwitchCost(f, alpha);
    for (const UndecidedField::Link& link : field_[f]) {
      const bool same = labels_[f] == labels_[link.face];
      if (!IsCandidate(link.face)) {
        cost += labels_[link.face] == alpha ? -link.weight : same ? link.weight : 0;
        continue;
      }
      // Different labels cost w now and 0 once both are alpha; half of it is charged to each end.
      if (!same) cost -= 0.5 * link.weight;
      const int other = node_[blocks_.index_in_block[link.face]];
      if (node < other) cut_.AddPair(node, other, same ? link.weight : 0.5 * link.weight);
    }
    cut_.AddCost(node, cost);
  }
  cut_.Solve();
  bool changed = false;
  for (int node = 0; node < count; ++node) {
    if (!cut_.Selected(node)) continue;
    labels_[candidates_[node]] = alpha;
    changed = true;
  }
  return changed;
}

}  // namespace tessera
