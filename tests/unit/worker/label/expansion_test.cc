#include "worker/label/expansion.h"

#include <gtest/gtest.h>

#include "tests/support/alpha_expansion.h"
#include "tests/support/label_energy.h"
#include "tests/support/mesh_field.h"
#include "worker/label/block_descent.h"

namespace tessera {
namespace {

// Expansions alone, with all faces undecided.
std::vector<int32_t> Expanded(const LabelField& field, std::vector<int32_t> labels) {
  const std::vector<int32_t> none(field.faces(), kUndecided);
  const UndecidedField undecided = MakeUndecidedField(field, MakeFieldGraph(field), none);
  std::vector<int32_t> by_number(labels.size());
  for (size_t i = 0; i < labels.size(); ++i) by_number[i] = labels[undecided.faces[i]];
  SweepBlocks(undecided, MakeBlocks(field, undecided, BlockGrid::kEven), {}, 50, &by_number);
  for (size_t i = 0; i < labels.size(); ++i) labels[undecided.faces[i]] = by_number[i];
  return labels;
}

TEST(Expansion, ResultIsALocalMinimumOfAlphaExpansion) {
  for (const double coupling : {0.3, 1.0, 3.0}) {
    LabelField field = MakeMeshField({.faces = 3000, .seed = 5, .unseen_area = 0.3, .coupling = coupling});
    field.cell.clear();
    const std::vector<int32_t> start(field.faces(), 0);
    const std::vector<int32_t> ours = Expanded(field, start);
    EXPECT_LT(LabelEnergy(field, ours), LabelEnergy(field, start));
    EXPECT_NEAR(LabelEnergy(field, ours), LabelEnergy(field, ExpandLabels(field, ours)), 1e-3);
  }
}

TEST(Expansion, EachBlockLowersTheEnergy) {
  for (const double cell_gsd : {3.0, 10.0, 32.0}) {
    const LabelField field =
        MakeMeshField({.faces = 3000, .seed = 6, .unseen_area = 0.3, .coupling = 1, .cell_gsd = cell_gsd});
    std::vector<int32_t> labels(field.faces(), 0);
    for (int turn = 0; turn < 3; ++turn) {
      const std::vector<int32_t> next = Expanded(field, labels);
      EXPECT_LE(LabelEnergy(field, next), LabelEnergy(field, labels) + 1e-3) << cell_gsd;
      if (turn == 0) {
        EXPECT_LT(LabelEnergy(field, next), LabelEnergy(field, labels)) << cell_gsd;
      }
      labels = next;
    }
  }
}

}  // namespace
}  // namespace tessera
