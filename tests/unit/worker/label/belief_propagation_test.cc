#include "worker/label/belief_propagation.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "common/base/parallel.h"
#include "common/base/random.h"

namespace tessera {
namespace {

// A random field; about every face has up to three neighbours.
LabelField RandomField(int faces, int classes, double coupling, bool tree, uint64_t seed) {
  Random random(seed);
  LabelField field;
  field.classes = classes;
  for (int i = 0; i < faces * classes; ++i) field.unary.push_back(static_cast<float>(random.Uniform(0, 2)));
  std::vector<int> degree(faces, 0);
  const auto add = [&](int a, int b) {
    field.edges.push_back(
        {static_cast<uint32_t>(a), static_cast<uint32_t>(b), static_cast<float>(coupling * random.Uniform())});
    ++degree[a];
    ++degree[b];
  };
  for (int f = 1; f < faces; ++f) add(static_cast<int>(random.Below(f)), f);
  for (int i = 0; !tree && i < faces; ++i) {
    const int a = static_cast<int>(random.Below(faces)), b = static_cast<int>(random.Below(faces));
    if (a < b && degree[a] < 3 && degree[b] < 3) add(a, b);
  }
  return field;
}

double LeastEnergy(const LabelField& field) {
  std::vector<int32_t> labels(field.faces(), 0);
  double least = LabelEnergy(field, labels);
  while (true) {
    size_t f = 0;
    while (f < labels.size() && ++labels[f] == field.classes) labels[f++] = 0;
    if (f == labels.size()) return least;
    least = std::min(least, LabelEnergy(field, labels));
  }
}

std::vector<int32_t> RandomLabels(const LabelField& field, uint64_t seed) {
  Random random(seed);
  std::vector<int32_t> labels(field.faces());
  for (int32_t& l : labels) l = static_cast<int32_t>(random.Below(field.classes));
  return labels;
}

TEST(BeliefPropagation, ExactOnTrees) {
  for (uint64_t seed = 0; seed < 40; ++seed) {
    const LabelField field = RandomField(9, 3, 2.0, true, seed);
    const Labelling solved = SolveLabels(field, RandomLabels(field, seed), {});
    EXPECT_NEAR(solved.energy, LeastEnergy(field), 1e-4) << seed;
  }
}

TEST(BeliefPropagation, NearlyAlwaysBestOnSmallFieldsWithLoops) {
  int best = 0;
  for (uint64_t seed = 0; seed < 60; ++seed) {
    const LabelField field = RandomField(9, 3, 1.5, false, seed);
    const double least = LeastEnergy(field);
    const Labelling solved = SolveLabels(field, RandomLabels(field, seed), {});
    EXPECT_LE(solved.energy, 1.1 * least + 1e-4) << seed;
    best += solved.energy <= least + 1e-4;
  }
  EXPECT_GE(best, 54);
}

TEST(BeliefPropagation, NeverAboveTheStart) {
  for (uint64_t seed = 0; seed < 60; ++seed) {
    const LabelField field = RandomField(60, 4, 6.0, false, seed);
    // The best of many solutions makes a start that is hard to beat.
    std::vector<int32_t> start = RandomLabels(field, seed);
    PolishLabels(field, 100, &start);
    for (uint64_t other = 0; other < 20; ++other) {
      std::vector<int32_t> labels = RandomLabels(field, 1000 * seed + other);
      PolishLabels(field, 100, &labels);
      TakeBetterParts(field, labels, &start);
    }
    const Labelling solved = SolveLabels(field, start, {.iterations = 3});
    EXPECT_DOUBLE_EQ(solved.start_energy, LabelEnergy(field, start));
    EXPECT_LE(solved.energy, solved.start_energy + 1e-4) << seed;
    EXPECT_DOUBLE_EQ(solved.energy, LabelEnergy(field, solved.labels));
  }
}

TEST(BeliefPropagation, TakingBetterPartsBeatsBoth) {
  for (uint64_t seed = 0; seed < 100; ++seed) {
    const LabelField field = RandomField(50, 3, 1.0, false, seed);
    const std::vector<int32_t> a = RandomLabels(field, seed), b = RandomLabels(field, seed + 5000);
    std::vector<int32_t> taken = a;
    TakeBetterParts(field, b, &taken);
    EXPECT_LE(LabelEnergy(field, taken), std::min(LabelEnergy(field, a), LabelEnergy(field, b)) + 1e-4);
  }
}

TEST(BeliefPropagation, UnseenFaceTakesItsNeighboursLabel) {
  LabelField field;
  field.classes = 3;
  field.unary = {2, 2, 0, 0, 0, 0, 2, 2, 0};
  field.edges = {{0, 1, 0.5f}, {1, 2, 0.5f}};
  EXPECT_EQ(SolveLabels(field, {-1, -1, -1}, {}).labels, (std::vector<int32_t>{2, 2, 2}));
}

TEST(BeliefPropagation, BeliefsAreLeastAtTheLabel) {
  const LabelField field = RandomField(200, 4, 4.0, false, 3);
  const Labelling solved = SolveLabels(field, RandomLabels(field, 1), {});
  const std::vector<float> confidence = LabelConfidence(4, solved.beliefs, solved.labels);
  for (size_t f = 0; f < field.faces(); ++f) {
    for (int l = 0; l < 4; ++l) {
      EXPECT_GE(solved.beliefs[4 * f + l], 0);
      if (l == solved.labels[f]) {
        EXPECT_EQ(solved.beliefs[4 * f + l], 0);
      }
    }
    EXPECT_GE(confidence[f], 0.25f);
    EXPECT_LE(confidence[f], 1.0f);
  }
}

TEST(BeliefPropagation, OneClassNeedsNoThought) {
  const LabelField field = RandomField(10, 1, 1.0, false, 3);
  EXPECT_EQ(SolveLabels(field, std::vector<int32_t>(10, 0), {}).labels, std::vector<int32_t>(10, 0));
}

TEST(BeliefPropagation, NoFaces) {
  LabelField field;
  field.classes = 2;
  EXPECT_TRUE(SolveLabels(field, {}, {}).labels.empty());
}

TEST(BeliefPropagation, SameBytesForAnyNumberOfThreads) {
  const LabelField field = RandomField(20000, 4, 1.5, false, 8);
  const std::vector<int32_t> start = RandomLabels(field, 2);
  const ThreadLimit one(1);
  const Labelling single = SolveLabels(field, start, {.iterations = 20});
  const ThreadLimit four(4);
  const Labelling many = SolveLabels(field, start, {.iterations = 20});
  EXPECT_EQ(single.labels, many.labels);
  EXPECT_EQ(single.beliefs, many.beliefs);
  EXPECT_EQ(single.energy, many.energy);
}

}  // namespace
}  // namespace tessera
