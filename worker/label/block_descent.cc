#include "worker/label/block_descent.h"

#include <algorithm>
#include <span>

#include "common/base/parallel.h"
#include "worker/label/expansion.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 8;

// Connected parts of a block in which two labellings differ. Reuses its buffers for all blocks.
class BlockParts {
 public:
  BlockParts(const UndecidedField& field, const Blocks& blocks, const std::vector<int32_t>& now,
             const std::vector<int32_t>& proposed)
      : field_(field), blocks_(blocks), now_(now), proposed_(proposed) {}

  // Calls take(face) for the faces of each connected part of {face of the block : differs(face)} that lowers the
  // energy. Faces of other blocks have their current label, or the worse of both where they differ as well.
  template <typename Differs, typename Take>
  void ApplyBetterParts(uint32_t block, const Differs& differs, const Take& take) {
    const std::span<const uint32_t> faces = blocks_[block];
    seen_.assign(faces.size(), 0);
    for (size_t start = 0; start < faces.size(); ++start) {
      if (seen_[start] || !differs(faces[start])) continue;
      part_.assign(1, faces[start]);
      seen_[start] = 1;
      double gain = 0;
      for (size_t i = 0; i < part_.size(); ++i) {
        const uint32_t f = part_[i];
        const float* cost = &field_.cost[f * field_.lanes];
        gain += static_cast<double>(cost[now_[f]]) - cost[proposed_[f]];
        for (const UndecidedField::Link& link : field_[f]) {
          const uint32_t g = link.face;
          const int before = now_[f] != now_[g], alone = before - (proposed_[f] != now_[g]);
          if (!differs(g)) {
            gain += alone * static_cast<double>(link.weight);
            continue;
          }
          const double half = 0.5 * (before - (proposed_[f] != proposed_[g]));
          if (blocks_.block[g] != block) {
            gain += std::min<double>(alone, half) * link.weight;
            continue;
          }
          gain += half * link.weight;  // the other end counts the other half
          if (!seen_[blocks_.index_in_block[g]]) {
            seen_[blocks_.index_in_block[g]] = 1;
            part_.push_back(g);
          }
        }
      }
      if (gain > 0) std::for_each(part_.begin(), part_.end(), take);
    }
  }

 private:
  const UndecidedField& field_;
  const Blocks& blocks_;
  const std::vector<int32_t>&now_, &proposed_;
  std::vector<uint8_t> seen_;
  std::vector<uint32_t> part_;
};

}  // namespace

std::vector<int32_t> ApplySafeParts(const UndecidedField& field, const Blocks& blocks,
                                    const std::vector<int32_t>& start, const std::vector<int32_t>& proposed) {
  std::vector<int32_t> labels = start;
  ParallelFor(static_cast<int64_t>(blocks.size()), kGrain, [&](int64_t begin, int64_t end) {
    BlockParts parts(field, blocks, start, proposed);
    const auto differs = [&](uint32_t f) { return start[f] != proposed[f]; };
    const auto take = [&](uint32_t f) { labels[f] = proposed[f]; };
    for (int64_t b = begin; b < end; ++b) parts.ApplyBetterParts(static_cast<uint32_t>(b), differs, take);
  });
  return labels;
}

void SweepBlocks(const UndecidedField& field, const Blocks& blocks,
                 const std::vector<const std::vector<int32_t>*>& proposals, int expansion_rounds,
                 std::vector<int32_t>* labels) {
  for (const std::vector<uint32_t>& turn : blocks.colours) {
    ParallelFor(static_cast<int64_t>(turn.size()), kGrain, [&](int64_t begin, int64_t end) {
      BlockExpansion expansion(field, blocks);
      for (int64_t i = begin; i < end; ++i) {
        const uint32_t block = turn[i];
        for (const std::vector<int32_t>* proposed : proposals) {
          BlockParts(field, blocks, *labels, *proposed)
              .ApplyBetterParts(
                  block,
                  [&](uint32_t f) {
                    return blocks.block[f] == block && !blocks.bridge[f] && (*labels)[f] != (*proposed)[f];
                  },
                  [&](uint32_t f) { (*labels)[f] = (*proposed)[f]; });
        }
        expansion.Run(block, expansion_rounds, labels);
      }
    });
  }
}

}  // namespace tessera
