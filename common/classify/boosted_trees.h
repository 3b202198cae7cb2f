// Gradient-boosted oblivious trees for several classes (Friedman 2001; Prokhorenkova et al. 2018). All nodes at one
// depth use the same test, so a tree is a table, and a row of pixels is evaluated without branches.
#pragma once

#include <cstdint>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// Training samples. `features`: column by column, `count` finite values each.
struct TrainingSamples {
  int64_t count = 0;
  int feature_count = 0;
  std::vector<float> features;
  std::vector<uint8_t> labels;  // class of each sample
  std::vector<float> weights;   // positive
  const float* column(int f) const { return features.data() + static_cast<int64_t>(f) * count; }
};

struct BoostingOptions {
  int trees = 220;
  int depth = 6;
  double feature_share = 0.4;  // share of the features that each tree may use
  uint64_t seed = 1;
};

// A trained ensemble. Tree t tests at depth d whether feature features[t * depth + d] exceeds
// thresholds[t * depth + d]. The results are the bits of the leaf's index (depth 0 is the lowest bit), and
// leaves[((t << depth) + leaf) * classes + c] is added to the score of class c.
struct BoostedTrees {
  int classes = 0;
  int feature_count = 0;
  int depth = 0;
  std::vector<float> base;  // score of each class before the first tree
  std::vector<int32_t> features;
  std::vector<float> thresholds;
  std::vector<float> leaves;

  int trees() const { return depth == 0 ? 0 : static_cast<int>(features.size()) / depth; }
  // Writes the scores of `count` samples to scores[i * classes + c]; feature f of sample i is values[f * stride + i].
  // The softmax of the scores gives class probabilities. Thread-safe.
  void Score(const float* values, int count, int stride, float* scores) const;
  // INVALID_ARGUMENT unless sizes, feature indices and values are valid, so that Score never reads out of bounds.
  // `name`: the model's name in the message.
  Status Check(const std::string& name) const;
};

inline constexpr int kMaxTreeDepth = 12;

// Trains on the samples `rows` (ascending; empty: all). `classes` is in [2, 254]; needs at least one sample. The result
// does not depend on the number of threads.
BoostedTrees TrainBoostedTrees(const TrainingSamples& samples, const std::vector<uint32_t>& rows, int classes,
                               const BoostingOptions& options);

}  // namespace tessera
