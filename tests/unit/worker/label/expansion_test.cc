#include "worker/label/expansion.h"

#include <gtest/gtest.h>

#include "tests/support/alpha_expansion.h"
#include "tests/support/mesh_field.h"

namespace tessera {
namespace {

// All faces open, so that numbers are faces but for their order.
std::vector<int32_t> Expanded(const LabelField& field, int part_faces, std::vector<int32_t> labels) {
  const std::vector<int32_t> none(field.faces(), kUndecided);
  const OpenField open = MakeOpenField(field, MakeFieldGraph(field), none);
  std::vector<int32_t> open_labels(labels.size());
  for (size_t i = 0; i < labels.size(); ++i) open_labels[i] = labels[open.faces[i]];
  LowerByExpansions(open, 50, part_faces, &open_labels);
  for (size_t i = 0; i < labels.size(); ++i) labels[open.faces[i]] = open_labels[i];
  return labels;
}

TEST(Expansion, LeavesAlphaExpansionNothingToDo) {
  for (const double coupling : {0.3, 1.0, 3.0}) {
    const LabelField field = MakeMeshField({.faces = 3000, .seed = 5, .unseen_area = 0.3, .coupling = coupling});
    const std::vector<int32_t> start(field.faces(), 0);
    const std::vector<int32_t> ours = Expanded(field, 1 << 20, start);
    EXPECT_LT(LabelEnergy(field, ours), LabelEnergy(field, start));
    EXPECT_NEAR(LabelEnergy(field, ours), LabelEnergy(field, ExpandLabels(field, ours)), 1e-3);
  }
}

TEST(Expansion, SmallPartsLowerTheEnergyToo) {
  const LabelField field = MakeMeshField({.faces = 3000, .seed = 6, .unseen_area = 0.3, .coupling = 1});
  const std::vector<int32_t> start(field.faces(), 0);
  double before = LabelEnergy(field, start);
  for (const int part_faces : {1, 7, 100, 3000}) {
    // Each starts where the one with smaller parts ended.
    const double energy = LabelEnergy(field, Expanded(field, part_faces, start));
    EXPECT_LE(energy, before + 1e-3) << part_faces;
    before = LabelEnergy(field, start);
  }
}

}  // namespace
}  // namespace tessera
