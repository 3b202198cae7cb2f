// Expansion moves (Boykov et al. 2001) within a block of cells.
#pragma once

#include <cstdint>
#include <vector>

#include "worker/label/min_cut.h"
#include "worker/label/undecided_field.h"

namespace tessera {

// Reuses its buffers from block to block. Not thread-safe; several objects may run concurrently on blocks of one
// colour.
class BlockExpansion {
 public:
  BlockExpansion(const UndecidedField& field, const Blocks& blocks) : field_(field), blocks_(blocks) {}

  // Runs an expansion move for each label in turn, `rounds` times or until nothing changes. Bridges and all other
  // blocks are fixed. Each move is optimal, so the energy never rises. `labels`: indexed by undecided number. Faces
  // are visited in their order in the block, so the result depends only on the block and the labels of linked faces.
  void Run(uint32_t block, int rounds, std::vector<int32_t>* labels);

 private:
  bool Expand(int32_t alpha);
  void FindCandidates(int32_t alpha);
  void Exclude(uint32_t face);
  bool IsCandidate(uint32_t face) const {
    return blocks_.block[face] == block_ && is_candidate_[blocks_.index_in_block[face]];
  }
  float SwitchCost(uint32_t face, int32_t alpha) const;
  float BestOnLink(uint32_t face, const UndecidedField::Link& link, int32_t alpha) const;

  const UndecidedField& field_;
  const Blocks& blocks_;
  int32_t* labels_ = nullptr;
  uint32_t block_ = 0;  // the vectors below are indexed by position in this block
  std::vector<uint8_t> is_candidate_;
  std::vector<float> link_weight_;  // total weight of a face's links
  std::vector<float> bound_;        // lower bound of the cost change when a candidate switches
  std::vector<int> node_;           // of a candidate in the cut's graph
  std::vector<uint32_t> candidates_, excluded_;
  MinCut cut_;
};

}  // namespace tessera
