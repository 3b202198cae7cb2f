#include "common/classify/boosted_trees.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/base/random.h"

namespace tessera {
namespace {

constexpr int kBins = 64;
constexpr double kLearningRate = 0.08;
constexpr double kRidge = 4;       // L2 regularisation: added to the hessian of each leaf, in units of the mean weight
constexpr double kRowShare = 0.5;  // share of the samples that each tree is fitted to

// Split candidates of a column: at most kBins - 1 ascending, distinct values that divide its samples into bins of about
// equal size. Each lies between the smallest and the largest value.
std::vector<float> Cuts(const float* column, const std::vector<uint32_t>& rows) {
  std::vector<float> values;
  const size_t step = std::max<size_t>(1, rows.size() / 20000);
  for (size_t i = 0; i < rows.size(); i += step) values.push_back(column[rows[i]]);
  std::sort(values.begin(), values.end());
  std::vector<float> cuts;
  for (int b = 1; b < kBins; ++b) {
    // Place the cut above all values that equal the quantile.
    const float low = values[values.size() * b / kBins];
    const auto above = std::upper_bound(values.begin(), values.end(), low);
    if (above == values.end()) break;
    const float cut = low + 0.5f * (*above - low);
    if (cuts.empty() || cuts.back() < cut) cuts.push_back(cut);
  }
  return cuts;
}

class Trainer {
 public:
  Trainer(const TrainingSamples& samples, std::vector<uint32_t> rows, int classes, const BoostingOptions& options)
      : samples_(samples), rows_(std::move(rows)), classes_(classes), options_(options) {}

  BoostedTrees Train() {
    Bin();
    const size_t n = rows_.size();
    BoostedTrees model;
    model.classes = classes_;
    model.feature_count = samples_.feature_count;
    model.depth = options_.depth;
    model.base.assign(classes_, 0);
    std::vector<double> mass(classes_, 1e-3);
    double total = 1e-3 * classes_;
    for (const uint32_t row : rows_) {
      mass[samples_.labels[row]] += samples_.weights[row];
      total += samples_.weights[row];
    }
    for (int c = 0; c < classes_; ++c) model.base[c] = static_cast<float>(std::log(mass[c] / total));
    mean_weight_ = total / static_cast<double>(n);
    scores_.resize(n * classes_);
    for (size_t i = 0; i < n; ++i) std::copy(model.base.begin(), model.base.end(), scores_.begin() + i * classes_);
    slopes_.resize(n * 2 * classes_);
    node_.resize(n);
    for (int t = 0; t < options_.trees; ++t) AddTree(t, &model);
    return model;
  }

 private:
  void Bin() {
    cuts_.resize(samples_.feature_count);
    bins_.resize(samples_.feature_count);
    ParallelForEach(samples_.feature_count, 1, [&](int64_t f) {
      const float* column = samples_.column(static_cast<int>(f));
      cuts_[f] = Cuts(column, rows_);
      bins_[f].resize(rows_.size());
      for (size_t i = 0; i < rows_.size(); ++i) {
        const auto at = std::lower_bound(cuts_[f].begin(), cuts_[f].end(), column[rows_[i]]);
        bins_[f][i] = static_cast<uint8_t>(at - cuts_[f].begin());
      }
    });
  }

  void FindSlopes() {
    ParallelFor(static_cast<int64_t>(rows_.size()), 4096, [&](int64_t begin, int64_t end) {
      std::vector<float> p(classes_);
      for (int64_t i = begin; i < end; ++i) {
        const float* score = scores_.data() + i * classes_;
        const float highest = *std::max_element(score, score + classes_);
        float sum = 0;
        for (int c = 0; c < classes_; ++c) sum += p[c] = std::exp(score[c] - highest);
        const float weight = samples_.weights[rows_[i]];
        const int label = samples_.labels[rows_[i]];
        float* slope = slopes_.data() + i * 2 * classes_;
        for (int c = 0; c < classes_; ++c) {
          const float share = p[c] / sum;
          slope[c] = weight * (share - (c == label ? 1.0f : 0.0f));
          slope[classes_ + c] = weight * share * (1 - share);
        }
      }
    });
  }

  // For each bin, the gain of a split after it, summed over all nodes of the depth. In an oblivious tree all nodes
  // share one split, so gains add up. The gain is the second-order one of the multi-class log loss, G^2 / (H + ridge),
  // with the gradient sums G and hessian sums H of both sides.
  void Gains(int f, int nodes, std::vector<float>* sums, std::vector<double>* gains) const {
    const int width = 2 * classes_;
    const int bins = static_cast<int>(cuts_[f].size()) + 1;
    sums->assign(static_cast<size_t>(nodes) * bins * width, 0.0f);
    gains->assign(bins, 0.0);
    const uint8_t* bin = bins_[f].data();
    for (const uint32_t i : chosen_) {
      float* sum = sums->data() + (static_cast<size_t>(node_[i]) * bins + bin[i]) * width;
      const float* slope = slopes_.data() + static_cast<size_t>(i) * width;
      for (int k = 0; k < width; ++k) sum[k] += slope[k];
    }
    const double ridge = kRidge * mean_weight_;
    std::vector<double> all(width), left(width);
    for (int node = 0; node < nodes; ++node) {
      const float* sum = sums->data() + static_cast<size_t>(node) * bins * width;
      std::fill(all.begin(), all.end(), 0.0);
      std::fill(left.begin(), left.end(), 0.0);
      for (int b = 0; b < bins; ++b) {
        for (int k = 0; k < width; ++k) all[k] += sum[b * width + k];
      }
      for (int b = 0; b + 1 < bins; ++b) {
        for (int k = 0; k < width; ++k) left[k] += sum[b * width + k];
        double gain = 0;
        for (int c = 0; c < classes_; ++c) {
          const double gl = left[c], hl = left[classes_ + c], gr = all[c] - gl, hr = all[classes_ + c] - hl;
          gain += gl * gl / (hl + ridge) + gr * gr / (hr + ridge);
        }
        (*gains)[b] += gain;
      }
    }
  }

  // Fits one tree to a random subset of rows and features (stochastic gradient boosting), which reduces overfitting.
  // Random draws depend on the seed and the tree's index only, and candidate splits are compared in the order of
  // features, so that the tree does not depend on threads.
  void AddTree(int tree, BoostedTrees* model) {
    FindSlopes();
    Random random(MixBits(options_.seed) + tree);
    chosen_.clear();
    for (uint32_t i = 0; i < rows_.size(); ++i) {
      if (random.Uniform() < kRowShare) chosen_.push_back(i);
    }
    if (chosen_.empty()) chosen_.push_back(static_cast<uint32_t>(random.Below(static_cast<int64_t>(rows_.size()))));
    std::vector<int> features(samples_.feature_count);
    std::iota(features.begin(), features.end(), 0);
    const int candidates =
        std::clamp(static_cast<int>(options_.feature_share * samples_.feature_count), 1, samples_.feature_count);
    for (int k = 0; k < candidates; ++k) {
      std::swap(features[k], features[k + random.Below(samples_.feature_count - k)]);
    }
    features.resize(candidates);

    std::fill(node_.begin(), node_.end(), 0);
    for (int depth = 0; depth < options_.depth; ++depth) {
      struct Best {
        double gain = -1;
        int bin = 0;
      };
      std::vector<Best> best(candidates);
      ParallelForEach(candidates, 1, [&](int64_t k) {
        std::vector<float> sums;
        std::vector<double> gains;
        Gains(features[k], 1 << depth, &sums, &gains);
        for (size_t b = 0; b + 1 < gains.size(); ++b) {
          if (gains[b] > best[k].gain) best[k] = {gains[b], static_cast<int>(b)};
        }
      });
      int chosen = 0;
      for (int k = 1; k < candidates; ++k) {
        if (best[k].gain > best[chosen].gain) chosen = k;
      }
      const int f = features[chosen];
      const bool splits = best[chosen].gain >= 0;  // false: all candidate features are constant
      model->features.push_back(f);
      model->thresholds.push_back(splits ? cuts_[f][best[chosen].bin] : samples_.column(f)[rows_[0]]);
      if (!splits) continue;
      for (size_t i = 0; i < rows_.size(); ++i) {
        node_[i] = static_cast<uint16_t>(node_[i] | (bins_[f][i] > best[chosen].bin ? 1 << depth : 0));
      }
    }
    AddLeaves(model);
  }

  void AddLeaves(BoostedTrees* model) {
    const int leaves = 1 << options_.depth, width = 2 * classes_;
    std::vector<double> sums(static_cast<size_t>(leaves) * width, 0.0);
    for (const uint32_t i : chosen_) {
      const float* slope = slopes_.data() + static_cast<size_t>(i) * width;
      double* sum = sums.data() + static_cast<size_t>(node_[i]) * width;
      for (int k = 0; k < width; ++k) sum[k] += slope[k];
    }
    const size_t first = model->leaves.size();
    const double ridge = kRidge * mean_weight_;
    for (int leaf = 0; leaf < leaves; ++leaf) {
      const double* sum = sums.data() + static_cast<size_t>(leaf) * width;
      for (int c = 0; c < classes_; ++c) {
        model->leaves.push_back(static_cast<float>(-kLearningRate * sum[c] / (sum[classes_ + c] + ridge)));
      }
    }
    for (size_t i = 0; i < rows_.size(); ++i) {
      const float* leaf = model->leaves.data() + first + static_cast<size_t>(node_[i]) * classes_;
      for (int c = 0; c < classes_; ++c) scores_[i * classes_ + c] += leaf[c];
    }
  }

  const TrainingSamples& samples_;
  const std::vector<uint32_t> rows_;
  const int classes_;
  const BoostingOptions& options_;
  double mean_weight_ = 1;
  std::vector<std::vector<float>> cuts_;
  std::vector<std::vector<uint8_t>> bins_;
  std::vector<float> scores_, slopes_;
  std::vector<uint16_t> node_;
  std::vector<uint32_t> chosen_;
};

// kClasses: the number of classes if it is known at compile time, else 0.
template <int kClasses>
void AddLeaves(const float* table, const int32_t* leaf, int count, int classes, float* scores) {
  const int k = kClasses > 0 ? kClasses : classes;
  for (int i = 0; i < count; ++i) {
    const float* from = table + static_cast<size_t>(leaf[i]) * k;
    for (int c = 0; c < k; ++c) scores[static_cast<size_t>(i) * k + c] += from[c];
  }
}

}  // namespace

void BoostedTrees::Score(const float* values, int count, int stride, float* scores) const {
  constexpr int kBatch = 64;
  int32_t leaf[kBatch];
  for (int first = 0; first < count; first += kBatch) {
    const int n = std::min(kBatch, count - first);
    for (int i = 0; i < n; ++i) std::copy(base.begin(), base.end(), scores + static_cast<size_t>(first + i) * classes);
    for (int t = 0; t < trees(); ++t) {
      std::fill_n(leaf, n, 0);
      for (int d = 0; d < depth; ++d) {
        const float* column = values + static_cast<size_t>(features[t * depth + d]) * stride + first;
        const float threshold = thresholds[t * depth + d];
        const int32_t bit = 1 << d;
        for (int i = 0; i < n; ++i) leaf[i] |= column[i] > threshold ? bit : 0;
      }
      const float* table = leaves.data() + (static_cast<size_t>(t) << depth) * classes;
      float* of_batch = scores + static_cast<size_t>(first) * classes;
      switch (classes) {
        case 2:
          AddLeaves<2>(table, leaf, n, 2, of_batch);
          break;
        case 3:
          AddLeaves<3>(table, leaf, n, 3, of_batch);
          break;
        case 4:
          AddLeaves<4>(table, leaf, n, 4, of_batch);
          break;
        default:
          AddLeaves<0>(table, leaf, n, classes, of_batch);
      }
    }
  }
}

Status BoostedTrees::Check(const std::string& name) const {
  const auto bad = [&](const std::string& found, const std::string& expected) {
    return InputError(name, "trees", found, expected);
  };
  if (classes < 2 || classes > 254) return bad(absl::StrCat(classes, " classes"), "2 to 254");
  if (depth < 1 || depth > kMaxTreeDepth)
    return bad(absl::StrCat("depth ", depth), absl::StrCat("1 to ", kMaxTreeDepth));
  if (features.empty() || features.size() % depth != 0 || features.size() > 1000000) {
    return bad(absl::StrCat(features.size(), " tests"), absl::StrCat("1 to 1000000, a multiple of the depth ", depth));
  }
  const size_t leaf_values = static_cast<size_t>(trees()) * (size_t{1} << depth) * classes;
  if (thresholds.size() != features.size() || leaves.size() != leaf_values ||
      base.size() != static_cast<size_t>(classes)) {
    return bad(
        absl::StrCat(thresholds.size(), " thresholds, ", leaves.size(), " leaf values, ", base.size(), " base scores"),
        absl::StrCat(features.size(), " thresholds, ", leaf_values, " leaf values, ", classes, " base scores"));
  }
  for (const int32_t f : features) {
    if (f < 0 || f >= feature_count) {
      return bad(absl::StrCat("feature ", f), absl::StrCat("0 to ", feature_count - 1));
    }
  }
  const auto finite = [](const std::vector<float>& values) {
    return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
  };
  if (!finite(thresholds) || !finite(leaves) || !finite(base)) return bad("NaN or infinity", "finite numbers");
  return absl::OkStatus();
}

BoostedTrees TrainBoostedTrees(const TrainingSamples& samples, const std::vector<uint32_t>& rows, int classes,
                               const BoostingOptions& options) {
  std::vector<uint32_t> all = rows;
  if (all.empty()) {
    all.resize(samples.count);
    std::iota(all.begin(), all.end(), 0u);
  }
  return Trainer(samples, std::move(all), classes, options).Train();
}

}  // namespace tessera
