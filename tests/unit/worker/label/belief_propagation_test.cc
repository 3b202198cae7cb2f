#include "worker/label/belief_propagation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "tests/support/alpha_expansion.h"
#include "tests/support/label_energy.h"
#include "tests/support/mesh_field.h"

namespace tessera {
namespace {

// A random field in which most faces have up to three neighbours.
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

// Calls visit(labels) for every labelling.
template <typename Visit>
void ForAllLabellings(const LabelField& field, const Visit& visit) {
  std::vector<int32_t> labels(field.faces(), 0);
  while (true) {
    visit(labels);
    size_t f = 0;
    while (f < labels.size() && ++labels[f] == field.classes) labels[f++] = 0;
    if (f == labels.size()) return;
  }
}

double LeastEnergy(const LabelField& field) {
  double least = std::numeric_limits<double>::infinity();
  ForAllLabellings(field, [&](const auto& labels) { least = std::min(least, LabelEnergy(field, labels)); });
  return least;
}

std::vector<int32_t> UnaryBest(const LabelField& field) {
  std::vector<int32_t> labels;
  for (size_t f = 0; f < field.faces(); ++f) {
    const auto unary = field.unary.begin() + f * field.classes;
    labels.push_back(static_cast<int32_t>(std::min_element(unary, unary + field.classes) - unary));
  }
  return labels;
}

// Mesh-like fields from easy to very hard.
std::vector<MeshFieldOptions> MeshFields(int faces, uint64_t seed) {
  const MeshFieldOptions real{.faces = faces, .seed = seed};
  MeshFieldOptions clear = real, noisy = real, unseen = real, strong = real, weak = real;
  clear.contrast = 3;
  clear.face_noise = 0.5;
  noisy.contrast = noisy.face_noise = 1.5;
  noisy.coupling = 0.8;
  unseen.unseen_area = 0.5;
  strong.contrast = 1;
  strong.coupling = 1.5;
  weak.contrast = 0.5;
  weak.coupling = 1;
  weak.wrong_area = 0.3;
  return {real, clear, noisy, unseen, strong, weak};
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
    EXPECT_NEAR(LabelEnergy(field, solved.labels), LeastEnergy(field), 1e-4) << seed;
  }
}

TEST(BeliefPropagation, ExactOnTreesOfAnyNumberOfClasses) {
  for (const int classes : {2, 4, 5, 8, 9, 13}) {
    for (uint64_t seed = 0; seed < 5; ++seed) {
      const LabelField field = RandomField(classes > 5 ? 4 : 6, classes, 2.0, true, seed);
      const Labelling solved = SolveLabels(field, RandomLabels(field, seed), {});
      EXPECT_NEAR(LabelEnergy(field, solved.labels), LeastEnergy(field), 1e-4) << classes << " classes, seed " << seed;
    }
  }
}

// Decided faces are included, except for messages between decided faces, which are only approximated.
TEST(BeliefPropagation, BeliefsOnTreesAreMinMarginals) {
  for (const double coupling : {0.2, 0.7, 2.0}) {
    for (uint64_t seed = 0; seed < 20; ++seed) {
      const LabelField field = RandomField(8, 3, coupling, true, seed);
      std::vector<double> exact(field.unary.size(), std::numeric_limits<double>::infinity());
      ForAllLabellings(field, [&](const auto& labels) {
        const double energy = LabelEnergy(field, labels);
        for (size_t f = 0; f < labels.size(); ++f) {
          exact[3 * f + labels[f]] = std::min(exact[3 * f + labels[f]], energy);
        }
      });
      const Labelling solved = SolveLabels(field, UnaryBest(field), {});
      for (size_t i = 0; i < exact.size(); ++i) {
        EXPECT_NEAR(solved.beliefs[i], exact[i] - LeastEnergy(field), 0.1) << coupling << " seed " << seed;
      }
    }
  }
}

TEST(BeliefPropagation, NearOptimalOnSmallFieldsWithLoops) {
  int best = 0;
  for (uint64_t seed = 0; seed < 60; ++seed) {
    const LabelField field = RandomField(9, 3, 1.5, false, seed);
    const double least = LeastEnergy(field);
    const Labelling solved = SolveLabels(field, RandomLabels(field, seed), {});
    const double energy = LabelEnergy(field, solved.labels);
    EXPECT_LE(energy, 1.1 * least + 1e-4) << seed;
    best += energy <= least + 1e-4;
  }
  EXPECT_GE(best, 59);
}

// Bar: within 0.05 % of the possible gain on every field.
TEST(BeliefPropagation, AsGoodAsAlphaExpansionOnMeshFields) {
  for (uint64_t seed = 1; seed <= 2; ++seed) {
    for (const MeshFieldOptions& options : MeshFields(4000, seed)) {
      const LabelField field = MakeMeshField(options);
      const std::vector<int32_t> start = UnaryBest(field);
      const Labelling solved = SolveLabels(field, std::vector<int32_t>(field.faces(), -1), {});
      const double energy = LabelEnergy(field, solved.labels), start_energy = LabelEnergy(field, start);
      const double best = std::min({energy, LabelEnergy(field, ExpandLabels(field, start)),
                                    LabelEnergy(field, ExpandLabels(field, solved.labels))});
      ASSERT_LT(best, start_energy);
      EXPECT_LE(energy - best, 0.0005 * (start_energy - best))
          << "contrast " << options.contrast << " coupling " << options.coupling << " seed " << seed;
    }
  }
}

TEST(BeliefPropagation, AsGoodAsAlphaExpansionOnRandomFields) {
  for (const double coupling : {0.5, 1.0, 2.0, 4.0}) {
    double above = 0, gain = 0;
    for (uint64_t seed = 0; seed < 10; ++seed) {
      const LabelField field = RandomField(500, 4, coupling, false, seed);
      const std::vector<int32_t> start = UnaryBest(field);
      const Labelling solved = SolveLabels(field, start, {});
      const double energy = LabelEnergy(field, solved.labels);
      const double best = std::min(energy, LabelEnergy(field, ExpandLabels(field, start)));
      above += energy - best;
      gain += LabelEnergy(field, start) - best;
    }
    EXPECT_LE(above, 0.0005 * gain) << coupling;
  }
}

// Lowers the energy face by face until nothing changes.
void DescendLabels(const LabelField& field, std::vector<int32_t>* labels) {
  for (bool changed = true; changed;) {
    changed = false;
    for (int32_t& label : *labels) {
      const int32_t before = label;
      double least = LabelEnergy(field, *labels) - 1e-6;
      int32_t best = before;
      for (label = 0; label < field.classes; ++label) {
        const double energy = LabelEnergy(field, *labels);
        if (energy < least) {
          least = energy;
          best = label;
        }
      }
      label = best;
      changed |= best != before;
    }
  }
}

TEST(BeliefPropagation, EnergyNeverExceedsTheStart) {
  for (uint64_t seed = 0; seed < 60; ++seed) {
    LabelField field = RandomField(60, 4, 6.0, false, seed);
    Random random(seed);
    for (size_t f = 0; f < field.faces(); ++f) field.cell.push_back({static_cast<int32_t>(random.Below(6)), 0});
    // The best of many solutions is a start that is hard to improve.
    std::vector<int32_t> start = RandomLabels(field, seed);
    for (uint64_t other = 0; other < 20; ++other) {
      std::vector<int32_t> labels = RandomLabels(field, 1000 * seed + other);
      DescendLabels(field, &labels);
      labels = ExpandLabels(field, labels);
      if (LabelEnergy(field, labels) < LabelEnergy(field, start)) start = labels;
    }
    const Labelling solved = SolveLabels(field, start, {.iterations = 3});
    EXPECT_LE(LabelEnergy(field, solved.labels), LabelEnergy(field, start) + 1e-4) << seed;
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

TEST(BeliefPropagation, OneClass) {
  const LabelField field = RandomField(10, 1, 1.0, false, 3);
  EXPECT_EQ(SolveLabels(field, std::vector<int32_t>(10, 0), {}).labels, std::vector<int32_t>(10, 0));
}

TEST(BeliefPropagation, NoFaces) {
  LabelField field;
  field.classes = 2;
  EXPECT_TRUE(SolveLabels(field, {}, {}).labels.empty());
}

TEST(BeliefPropagation, ResultIsIndependentOfThreads) {
  for (const MeshFieldOptions& options : MeshFields(20000, 8)) {
    const LabelField field = MakeMeshField(options);
    const std::vector<int32_t> start = RandomLabels(field, 2);
    const ThreadLimit one(1);
    const Labelling single = SolveLabels(field, start, {});
    const ThreadLimit four(4);
    const Labelling many = SolveLabels(field, start, {});
    EXPECT_EQ(single.labels, many.labels);
    EXPECT_EQ(single.beliefs, many.beliefs);
  }
}

}  // namespace
}  // namespace tessera
