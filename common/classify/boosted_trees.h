// Gradient-boosted oblivious trees for several classes: all nodes of one depth ask the same question, so that a tree is
// a table and a row of pixels goes through it without a branch (Friedman 2001; oblivious trees as in Prokhorenkova et
// al. 2018).
#ifndef TESSERA_COMMON_CLASSIFY_BOOSTED_TREES_H_
#define TESSERA_COMMON_CLASSIFY_BOOSTED_TREES_H_

#include <cstdint>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// Samples to learn from. `features`: column after column, `count` values each, finite.
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
  double rate = 0.08;
  double ridge = 4;            // added to the curvature of every leaf, in mean weights
  double row_share = 0.5;      // of the samples that each tree sees
  double feature_share = 0.4;  // of the features that each tree may ask for
  uint64_t seed = 1;
};

// A plain value. Tree t asks at depth d whether features[t * depth + d] exceeds thresholds[t * depth + d]; the answers,
// first depth as lowest bit, are the leaf's number, and leaves[((t << depth) + leaf) * classes + c] adds to the score
// of class c.
struct BoostedTrees {
  int classes = 0;
  int feature_count = 0;
  int depth = 0;
  std::vector<float> base;  // score of each class before the first tree
  std::vector<int32_t> features;
  std::vector<float> thresholds;
  std::vector<float> leaves;

  int trees() const { return depth == 0 ? 0 : static_cast<int>(features.size()) / depth; }
  // Scores of `count` samples, feature f of sample i in values[f * stride + i], to scores[i * classes + c]. Softmax of
  // them is the classes' probability. Any thread.
  void Score(const float* values, int count, int stride, float* scores) const;
  // INVALID_ARGUMENT unless sizes, features and numbers are such that Score reads nothing else; `name` for the message.
  Status Check(const std::string& name) const;
};

inline constexpr int kMaxTreeDepth = 12;

// Learns from the samples `rows` (ascending; empty: all). `classes` in [2, 254]; at least one sample. The same bytes
// for any number of threads.
BoostedTrees TrainBoostedTrees(const TrainingSamples& samples, const std::vector<uint32_t>& rows, int classes,
                               const BoostingOptions& options);

}  // namespace tessera

#endif  // TESSERA_COMMON_CLASSIFY_BOOSTED_TREES_H_
