#include "common/classify/boosted_trees.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "common/base/parallel.h"
#include "common/base/random.h"

namespace tessera {
namespace {

constexpr int kFeatures = 5, kClasses = 3;

// Class 0 where the first two features differ in sign, else 1 or 2 by the third: no single test separates them.
TrainingSamples Checkers(int64_t count, uint64_t seed) {
  TrainingSamples samples;
  samples.count = count;
  samples.feature_count = kFeatures;
  samples.features.resize(count * kFeatures);
  Random random(seed);
  for (int64_t i = 0; i < count; ++i) {
    float value[kFeatures];
    for (int f = 0; f < kFeatures; ++f) {
      value[f] = static_cast<float>(random.Uniform(-1, 1));
      samples.features[f * count + i] = value[f];
    }
    samples.labels.push_back((value[0] > 0) != (value[1] > 0) ? 0 : value[2] > 0.25f ? 1 : 2);
    samples.weights.push_back(1);
  }
  return samples;
}

BoostingOptions Small() {
  BoostingOptions options;
  options.trees = 60;
  options.depth = 4;
  options.feature_share = 1;
  return options;
}

// Scores one sample test by test, as the declaration defines it.
std::vector<double> ScoreNaively(const BoostedTrees& trees, const TrainingSamples& samples, int64_t sample) {
  std::vector<double> scores(trees.base.begin(), trees.base.end());
  for (int t = 0; t < trees.trees(); ++t) {
    int leaf = 0;
    for (int d = 0; d < trees.depth; ++d) {
      const int question = t * trees.depth + d;
      if (samples.column(trees.features[question])[sample] > trees.thresholds[question]) leaf += 1 << d;
    }
    for (int c = 0; c < trees.classes; ++c) scores[c] += trees.leaves[((t << trees.depth) + leaf) * trees.classes + c];
  }
  return scores;
}

std::vector<float> ScoreAll(const BoostedTrees& trees, const TrainingSamples& samples) {
  std::vector<float> scores(samples.count * trees.classes);
  trees.Score(samples.features.data(), static_cast<int>(samples.count), static_cast<int>(samples.count), scores.data());
  return scores;
}

double Accuracy(const BoostedTrees& trees, const TrainingSamples& samples) {
  const std::vector<float> scores = ScoreAll(trees, samples);
  int64_t right = 0;
  for (int64_t i = 0; i < samples.count; ++i) {
    const float* of = scores.data() + i * trees.classes;
    right += std::max_element(of, of + trees.classes) - of == samples.labels[i];
  }
  return static_cast<double>(right) / static_cast<double>(samples.count);
}

TEST(BoostedTreesTest, BatchScoresEqualSingleScores) {
  const TrainingSamples samples = Checkers(777, 3);  // no multiple of a batch
  const BoostedTrees trees = TrainBoostedTrees(samples, {}, kClasses, Small());
  ASSERT_TRUE(trees.Check("trees").ok());
  const std::vector<float> scores = ScoreAll(trees, samples);
  for (int64_t i = 0; i < samples.count; ++i) {
    const std::vector<double> expected = ScoreNaively(trees, samples, i);
    for (int c = 0; c < kClasses; ++c) ASSERT_NEAR(scores[i * kClasses + c], expected[c], 1e-4) << i << " " << c;
  }
}

TEST(BoostedTreesTest, LearnsInteractionsOfFeatures) {
  const BoostedTrees trees = TrainBoostedTrees(Checkers(4000, 1), {}, kClasses, Small());
  EXPECT_GT(Accuracy(trees, Checkers(4000, 2)), 0.95);  // .5 by the commonest class, .6 by single questions
}

TEST(BoostedTreesTest, IgnoresRowsOutsideTheSubset) {
  TrainingSamples samples = Checkers(2000, 1);
  std::vector<uint32_t> rows;
  for (uint32_t i = 0; i < 1000; ++i) rows.push_back(i);
  const BoostedTrees before = TrainBoostedTrees(samples, rows, kClasses, Small());
  for (int64_t i = 1000; i < 2000; ++i) {
    samples.labels[i] = 1;
    for (int f = 0; f < kFeatures; ++f) samples.features[f * samples.count + i] = 1000;
  }
  const BoostedTrees after = TrainBoostedTrees(samples, rows, kClasses, Small());
  EXPECT_EQ(before.thresholds, after.thresholds);
  EXPECT_EQ(before.leaves, after.leaves);
}

TEST(BoostedTreesTest, DoesNotDependOnThreads) {
  const TrainingSamples samples = Checkers(3000, 1);
  BoostedTrees one;
  {
    const ThreadLimit limit(1);
    one = TrainBoostedTrees(samples, {}, kClasses, Small());
  }
  const ThreadLimit limit(4);
  const BoostedTrees four = TrainBoostedTrees(samples, {}, kClasses, Small());
  EXPECT_EQ(one.features, four.features);
  EXPECT_EQ(one.thresholds, four.thresholds);
  EXPECT_EQ(one.leaves, four.leaves);
}

TEST(BoostedTreesTest, HandlesConstantFeaturesAndASingleClass) {
  TrainingSamples samples;
  samples.count = 50;
  samples.feature_count = 2;
  samples.features.assign(100, 3.0f);
  samples.labels.assign(50, 1);
  samples.weights.assign(50, 1.0f);
  const BoostedTrees trees = TrainBoostedTrees(samples, {}, 2, Small());
  ASSERT_TRUE(trees.Check("trees").ok());
  EXPECT_EQ(Accuracy(trees, samples), 1);
}

TEST(BoostedTreesTest, CheckRejectsOutOfBoundsModels) {
  const BoostedTrees good = TrainBoostedTrees(Checkers(200, 1), {}, kClasses, Small());
  const auto refused = [&](auto change) {
    BoostedTrees trees = good;
    change(trees);
    return absl::IsInvalidArgument(trees.Check("FILE"));
  };
  EXPECT_TRUE(refused([](BoostedTrees& t) { t.features[3] = kFeatures; }));
  EXPECT_TRUE(refused([](BoostedTrees& t) { t.features[3] = -1; }));
  EXPECT_TRUE(refused([](BoostedTrees& t) { t.thresholds.pop_back(); }));
  EXPECT_TRUE(refused([](BoostedTrees& t) { t.leaves.pop_back(); }));
  EXPECT_TRUE(refused([](BoostedTrees& t) { t.base.pop_back(); }));
  EXPECT_TRUE(refused([](BoostedTrees& t) { t.depth = 40; }));
  EXPECT_TRUE(refused([](BoostedTrees& t) { t.depth = 0; }));
  EXPECT_TRUE(refused([](BoostedTrees& t) { t.leaves[5] = std::numeric_limits<float>::quiet_NaN(); }));
  EXPECT_FALSE(refused([](BoostedTrees&) {}));
}

}  // namespace
}  // namespace tessera
