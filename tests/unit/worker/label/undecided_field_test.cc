#include "worker/label/undecided_field.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/label_energy.h"
#include "tests/support/mesh_field.h"

namespace tessera {
namespace {

TEST(UndecidedField, DecidedLabelsAreOptimal) {
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

TEST(UndecidedField, EnergiesDifferByAConstant) {
  const LabelField field = MakeMeshField({.faces = 500, .seed = 4, .coupling = 0.7});
  const FieldGraph graph = MakeFieldGraph(field);
  const std::vector<int32_t> decided = DecideFaces(field, graph);
  const UndecidedField undecided = MakeUndecidedField(field, graph, decided);
  ASSERT_GT(undecided.size(), 50u);
  ASSERT_LT(undecided.size(), field.faces());
  double difference = 0;
  for (int round = 0; round < 5; ++round) {
    std::vector<int32_t> labels = decided;
    double energy = 0;
    for (size_t i = 0; i < undecided.size(); ++i) {
      labels[undecided.faces[i]] = static_cast<int32_t>((i * (round + 1)) % 4);
      energy += undecided.cost[i * undecided.lanes + labels[undecided.faces[i]]];
    }
    for (size_t i = 0; i < undecided.size(); ++i) {
      for (const UndecidedField::Link& link : undecided[i]) {
        EXPECT_EQ(undecided.links[link.reverse].face, i);
        EXPECT_EQ(undecided.links[link.reverse].weight, link.weight);
        if (labels[undecided.faces[i]] != labels[undecided.faces[link.face]]) energy += 0.5 * link.weight;
      }
    }
    if (round == 0) difference = LabelEnergy(field, labels) - energy;
    EXPECT_NEAR(LabelEnergy(field, labels) - energy, difference, 1e-3);
  }
}

TEST(UndecidedField, BlocksPartitionTheFacesInFieldOrder) {
  LabelField field = MakeMeshField({.faces = 3000, .seed = 5, .coupling = 1, .shuffled = true});
  for (size_t f = 0; f < field.faces(); f += 7) field.cell[f][0] += 8;  // as far as large faces would be
  const FieldGraph graph = MakeFieldGraph(field);
  const UndecidedField undecided = MakeUndecidedField(field, graph, DecideFaces(field, graph));
  for (const BlockGrid grid : {BlockGrid::kEven, BlockGrid::kOdd}) {
    const Blocks blocks = MakeBlocks(field, undecided, grid);
    std::vector<int> times(undecided.size(), 0);
    size_t bridges = 0;
    std::vector<int> colour(blocks.size(), -1);
    for (int c = 0; c < 4; ++c) {
      for (const uint32_t b : blocks.colours[c]) colour[b] = c;
    }
    for (uint32_t b = 0; b < blocks.size(); ++b) {
      for (size_t i = 0; i < blocks[b].size(); ++i) {
        const uint32_t n = blocks[b][i];
        ++times[n];
        EXPECT_EQ(blocks.block[n], b);
        EXPECT_EQ(blocks.index_in_block[n], i);
        EXPECT_EQ(BlockOf(field.cell[undecided.faces[n]], grid),
                  BlockOf(field.cell[undecided.faces[blocks[b][0]]], grid));
        if (i > 0) {
          EXPECT_LT(undecided.faces[blocks[b][i - 1]], undecided.faces[n]);
        }
        for (const UndecidedField::Link& link : undecided[n]) {
          const uint32_t other = blocks.block[link.face];
          if (!blocks.bridge[n]) {
            EXPECT_TRUE(other == b || colour[other] != colour[b]);
          }
        }
        bridges += blocks.bridge[n];
      }
    }
    EXPECT_EQ(times, std::vector<int>(undecided.size(), 1));
    EXPECT_GT(bridges, 0u);
    EXPECT_LT(bridges, undecided.size());
  }
}

}  // namespace
}  // namespace tessera
