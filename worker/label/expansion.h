// Expansion moves (Boykov et al. 2001) within a block of cells.
#ifndef TESSERA_WORKER_LABEL_EXPANSION_H_
#define TESSERA_WORKER_LABEL_EXPANSION_H_

#include <cstdint>
#include <vector>

#include "worker/label/min_cut.h"
#include "worker/label/undecided_field.h"

namespace tessera {

// Meant to be used for one block after the other: it keeps its memory. Not thread-safe; several at once may work on
// blocks of one colour.
class BlockExpansion {
 public:
  BlockExpansion(const UndecidedField& field, const Blocks& blocks) : field_(field), blocks_(blocks) {}

  // Lets one label after the other take all the faces of the block that it can win, `rounds` times or until nothing
  // changes; bridges and all other blocks stay as they are. Each move is the best there is, so that the energy never
  // rises. `labels`: by the field's numbers. Faces go by their order in the block, so the result depends on the block
  // and the labels it is linked to alone.
  void Run(uint32_t block, int rounds, std::vector<int32_t>* labels);

 private:
  bool Expand(int32_t alpha);
  void FindCandidates(int32_t alpha);
  void Exclude(uint32_t face);
  bool Candidate(uint32_t face) const { return blocks_.block[face] == block_ && may_[blocks_.place[face]]; }
  float SwitchCost(uint32_t face, int32_t alpha) const;
  float BestOnLink(uint32_t face, const UndecidedField::Link& link, int32_t alpha) const;

  const UndecidedField& field_;
  const Blocks& blocks_;
  int32_t* labels_ = nullptr;
  uint32_t block_ = 0;  // what follows is by place in it
  std::vector<uint8_t> may_;
  std::vector<float> most_;   // what the links of a face weigh
  std::vector<float> bound_;  // least that switching a candidate may cost
  std::vector<int> node_;     // of a candidate in the cut
  std::vector<uint32_t> candidates_, out_;
  MinCut cut_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_LABEL_EXPANSION_H_
