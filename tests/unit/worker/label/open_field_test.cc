#include "worker/label/open_field.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/mesh_field.h"

namespace tessera {
namespace {

TEST(OpenField, DecidedLabelsAreNeverWorse) {
  int64_t count = 0;
  for (const double coupling : {0.3, 0.5, 1.0}) {
    const LabelField field = MakeMeshField({.faces = 500, .seed = 3, .coupling = coupling});
    const std::vector<int32_t> decided = DecideFaces(field, MakeFieldGraph(field));
    for (int32_t label = 0; label < field.classes; ++label) {
      const std::vector<int32_t> labels(field.faces(), label);
      std::vector<int32_t> taken = labels;
      for (size_t f = 0; f < taken.size(); ++f) taken[f] = decided[f] == kUndecided ? label : decided[f];
      EXPECT_LE(LabelEnergy(field, taken), LabelEnergy(field, labels) + 1e-4);
    }
    count += std::count_if(decided.begin(), decided.end(), [](int32_t l) { return l != kUndecided; });
  }
  EXPECT_GT(count, 500);  // of 1500
}

TEST(OpenField, EnergiesDifferByAConstant) {
  const LabelField field = MakeMeshField({.faces = 500, .seed = 4, .coupling = 0.7});
  const FieldGraph graph = MakeFieldGraph(field);
  const std::vector<int32_t> decided = DecideFaces(field, graph);
  const OpenField open = MakeOpenField(field, graph, decided);
  ASSERT_GT(open.size(), 50u);
  ASSERT_LT(open.size(), field.faces());
  double difference = 0;
  for (int round = 0; round < 5; ++round) {
    std::vector<int32_t> labels = decided;
    double energy = 0;
    for (size_t i = 0; i < open.size(); ++i) {
      labels[open.faces[i]] = static_cast<int32_t>((i * (round + 1)) % 4);
      energy += open.cost[i * open.lanes + labels[open.faces[i]]];
    }
    for (size_t i = 0; i < open.size(); ++i) {
      for (const OpenField::Link& link : open[i]) {
        EXPECT_EQ(open.links[link.reverse].face, i);
        EXPECT_EQ(open.links[link.reverse].weight, link.weight);
        if (labels[open.faces[i]] != labels[open.faces[link.face]]) energy += 0.5 * link.weight;
      }
    }
    if (round == 0) difference = LabelEnergy(field, labels) - energy;
    EXPECT_NEAR(LabelEnergy(field, labels) - energy, difference, 1e-3);
  }
}

}  // namespace
}  // namespace tessera
