#include "worker/label/block_descent.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "common/base/random.h"
#include "tests/support/label_energy.h"
#include "tests/support/mesh_field.h"

namespace tessera {
namespace {

// A field with all faces undecided, in small cells, and random labels indexed by undecided number.
struct Fixture {
  LabelField field;
  UndecidedField undecided;
  Random random;

  explicit Fixture(uint64_t seed)
      : field(MakeMeshField({.faces = 300, .seed = seed, .coupling = 1, .cell_gsd = 8})), random(seed) {
    undecided = MakeUndecidedField(field, MakeFieldGraph(field), std::vector<int32_t>(field.faces(), kUndecided));
  }
  std::vector<int32_t> Labels() {
    std::vector<int32_t> labels(undecided.size());
    for (int32_t& l : labels) l = static_cast<int32_t>(random.Below(field.classes));
    return labels;
  }
  double Energy(const std::vector<int32_t>& labels) const {
    std::vector<int32_t> by_face(labels.size());
    for (size_t i = 0; i < labels.size(); ++i) by_face[undecided.faces[i]] = labels[i];
    return LabelEnergy(field, by_face);
  }
};

// Not only all switches together: any subset of the blocks' switches lowers the energy.
TEST(BlockDescent, SafePartsLowerTheEnergyInAnyCombinationOfBlocks) {
  int64_t taken = 0;
  for (uint64_t seed = 0; seed < 50; ++seed) {
    Fixture f(seed);
    const Blocks blocks = MakeBlocks(f.field, f.undecided, BlockGrid::kEven);
    const std::vector<int32_t> start = f.Labels(), proposed = f.Labels();
    const std::vector<int32_t> all = ApplySafeParts(f.undecided, blocks, start, proposed);
    for (int round = 0; round < 10; ++round) {
      std::vector<uint8_t> chosen(blocks.size());
      for (uint8_t& c : chosen) c = f.random.Below(2) > 0;
      std::vector<int32_t> labels = start;
      for (size_t i = 0; i < labels.size(); ++i) {
        if (chosen[blocks.block[i]]) labels[i] = all[i];
      }
      EXPECT_LE(f.Energy(labels), f.Energy(start) + 1e-3) << seed;
    }
    for (size_t i = 0; i < all.size(); ++i) taken += all[i] != start[i];
  }
  EXPECT_GT(taken, 1000);
}

TEST(BlockDescent, SweepNeverRaisesTheEnergy) {
  for (uint64_t seed = 0; seed < 50; ++seed) {
    Fixture f(seed);
    for (size_t face = 0; face < f.field.faces(); face += 5) f.field.cell[face][0] += 4;  // bridges
    for (const BlockGrid grid : {BlockGrid::kEven, BlockGrid::kOdd}) {
      const std::vector<int32_t> start = f.Labels(), proposed = f.Labels();
      std::vector<int32_t> labels = start;
      SweepBlocks(f.undecided, MakeBlocks(f.field, f.undecided, grid), {&proposed}, 0, &labels);
      EXPECT_LT(f.Energy(labels), f.Energy(start));
      const std::vector<int32_t> before = labels;
      SweepBlocks(f.undecided, MakeBlocks(f.field, f.undecided, grid), {}, 2, &labels);
      EXPECT_LT(f.Energy(labels), f.Energy(before));
    }
  }
}

}  // namespace
}  // namespace tessera
