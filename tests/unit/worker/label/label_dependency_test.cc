#include "worker/label/label_dependency.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "tests/support/label_energy.h"
#include "tests/support/mesh_field.h"
#include "worker/label/undecided_field.h"

namespace tessera {
namespace {

struct Problem {
  LabelField field;
  std::vector<int32_t> start;
  SolverOptions options;
  std::vector<uint8_t> core;
};

std::vector<std::array<uint32_t, 2>> LinksOf(const LabelField& field) {
  std::vector<std::array<uint32_t, 2>> links;
  for (const FieldEdge& e : field.edges) links.push_back({e.face0, e.face1});
  return links;
}

float RandomCost(bool whole, Random* random) {
  return whole ? static_cast<float>(random->Below(4)) : static_cast<float>(random->Uniform(0, 3));
}

SolverOptions RandomOptions(Random* random) {
  SolverOptions options;
  options.iterations = static_cast<int>(random->Below(7));
  options.damping = random->Below(2) ? 0 : random->Uniform(0, 0.9);
  options.expansion_rounds = static_cast<int>(random->Below(4));
  return options;
}

// A cell whose even and odd blocks have these colours; different for every `place`.
Cell CellOf(int even, int odd, int32_t place) {
  for (int32_t i = 0; i < 16; ++i) {
    const Cell cell = {i % 4 + 4 * place, i / 4 + 4 * place};
    if (ColourOf(BlockOf(cell, BlockGrid::kEven), BlockGrid::kEven) == even &&
        ColourOf(BlockOf(cell, BlockGrid::kOdd), BlockGrid::kOdd) == odd) {
      return cell;
    }
  }
  ADD_FAILURE() << "no cell with colours " << even << " and " << odd;
  return {};
}

// A strip of faces that is much longer than the dependency radius. Cells follow each other as on the ground, or have
// colours for which changes travel furthest over the sweeps, and lie far apart like those of large faces. Costs are
// many or few; integer costs make ties. Where weights decrease along the strip, faces follow their predecessors.
Problem RandomStrip(uint64_t seed) {
  Random random(seed);
  Problem p;
  p.options = RandomOptions(&random);
  const int faces = 40 + static_cast<int>(random.Below(100));
  const bool whole = random.Below(2), falling = random.Below(2), passing = random.Below(2);
  const double jumps = random.Below(2) ? 0.2 * random.Uniform() : 0, coupling = random.Uniform(0.5, 3);
  const double run = random.Uniform(1, 3), unseen = random.Uniform(), rungs = random.Below(2) ? random.Uniform() : 0;
  p.field.classes = 2 + static_cast<int>(random.Below(random.Below(2) ? 1 : 8));
  Cell cell = {static_cast<int32_t>(random.Below(9)) - 4, static_cast<int32_t>(random.Below(9)) - 4};
  const int direction = static_cast<int>(random.Below(3)), phase = static_cast<int>(random.Below(4));
  for (int f = 0, runs = 0; f < faces; ++f) {
    const bool blank = random.Uniform() < unseen;
    for (int l = 0; l < p.field.classes; ++l) {
      p.field.unary.push_back(RandomCost(whole, &random) * (blank ? (whole ? 0 : 0.01f) : 1.0f));
    }
    p.start.push_back(static_cast<int32_t>(random.Below(p.field.classes + 1)) - 1);
    if (random.Uniform() < 1 / run) {
      ++runs;
      cell[direction < 2 ? direction : random.Below(2)] += 1;
      if (passing) cell = CellOf(runs % 4, (runs + phase) % 4, static_cast<int32_t>(random.Below(2000)));
    }
    p.field.cell.push_back(cell);
    if (random.Uniform() < jumps) p.field.cell.back()[random.Below(2)] += static_cast<int32_t>(random.Below(9)) - 4;
    const auto link = [&](int other) {
      const double weight = falling ? 3 * std::pow(0.99, f) : RandomCost(whole, &random);
      p.field.edges.push_back(
          {static_cast<uint32_t>(other), static_cast<uint32_t>(f), static_cast<float>(coupling * weight)});
    };
    if (f > 0) link(f - 1);
    if (f > 2 && f % 2 && random.Uniform() < rungs) link(f - 3);
  }
  p.core.assign(faces, 0);
  const int first = static_cast<int>(random.Below(faces));
  const int last = std::min<int>(faces, first + 1 + static_cast<int>(random.Below(3)));
  std::fill(p.core.begin() + first, p.core.begin() + last, 1);
  return p;
}

// A different problem that agrees only in the faces of `kept` and the edges between them.
Problem Perturbed(const Problem& p, const std::vector<uint8_t>& kept, Random* random) {
  Problem other = p;
  for (size_t f = 0; f < p.field.faces(); ++f) {
    if (kept[f]) continue;
    for (int l = 0; l < p.field.classes; ++l) other.field.unary[f * p.field.classes + l] = RandomCost(false, random);
    other.start[f] = static_cast<int32_t>(random->Below(p.field.classes + 1)) - 1;
  }
  for (FieldEdge& e : other.field.edges) {
    if (!kept[e.face0] || !kept[e.face1]) e.weight = 4 * RandomCost(true, random);
  }
  return other;
}

// The problem restricted to the faces of `kept`; `faces` receives their indices.
Problem CutDown(const Problem& p, const std::vector<uint8_t>& kept, std::vector<uint32_t>* faces) {
  Problem part;
  part.options = p.options;
  part.field.classes = p.field.classes;
  std::vector<uint32_t> number(kept.size(), 0);
  faces->clear();
  for (uint32_t f = 0; f < kept.size(); ++f) {
    if (!kept[f]) continue;
    number[f] = static_cast<uint32_t>(faces->size());
    faces->push_back(f);
    part.field.unary.insert(part.field.unary.end(), p.field.unary.begin() + f * p.field.classes,
                            p.field.unary.begin() + (f + 1) * p.field.classes);
    part.field.cell.push_back(p.field.cell[f]);
    part.start.push_back(p.start[f]);
    part.core.push_back(p.core[f]);
  }
  for (const FieldEdge& e : p.field.edges) {
    if (kept[e.face0] && kept[e.face1]) part.field.edges.push_back({number[e.face0], number[e.face1], e.weight});
  }
  return part;
}

// Labels and beliefs of the core.
std::pair<std::vector<int32_t>, std::vector<float>> CoreOf(const Problem& p) {
  const Labelling solved = SolveLabels(p.field, p.start, p.options);
  std::pair<std::vector<int32_t>, std::vector<float>> core;
  for (size_t f = 0; f < p.core.size(); ++f) {
    if (!p.core[f]) continue;
    core.first.push_back(solved.labels[f]);
    core.second.insert(core.second.end(), solved.beliefs.begin() + f * p.field.classes,
                       solved.beliefs.begin() + (f + 1) * p.field.classes);
  }
  return core;
}

// Whether labels and beliefs of the core stay the same when everything outside the radius changes.
bool Holds(const Problem& p, const LabelDependencyRadius& reach, uint64_t seed, int64_t* outside) {
  Random random(seed ^ 0x5eed);
  const std::vector<uint8_t> kept = FacesInDependencyRadius(LinksOf(p.field), p.field.cell, p.core, reach);
  *outside += std::count(kept.begin(), kept.end(), 0);
  std::vector<uint32_t> faces;
  const auto whole = CoreOf(p);
  return whole == CoreOf(CutDown(p, kept, &faces)) && whole == CoreOf(Perturbed(p, kept, &random));
}

TEST(LabelDependency, FacesOutsideTheRadiusDoNotMatterOnStrips) {
  int64_t outside = 0;
  for (uint64_t seed = 0; seed < 3000; ++seed) {
    const Problem p = RandomStrip(seed);
    ASSERT_TRUE(Holds(p, LabelDependencyRadiusOf(p.options), seed, &outside)) << seed;
  }
  EXPECT_GT(outside, 3000 * 10);
}

TEST(LabelDependency, FacesOutsideTheRadiusDoNotMatterOnMeshes) {
  int64_t outside = 0;
  for (uint64_t seed = 0; seed < 40; ++seed) {
    Random random(seed);
    Problem p;
    p.field = MakeMeshField({.faces = 6000,
                             .classes = 2 + static_cast<int>(random.Below(5)),
                             .seed = seed,
                             .patch_faces = 100,
                             .contrast = random.Uniform(0, 2),
                             .unseen_area = random.Uniform(0, 0.6),
                             .coupling = random.Uniform(0.2, 2),
                             .cell_gsd = random.Uniform(2, 8),
                             .shuffled = random.Below(2) > 0});
    p.options = RandomOptions(&random);
    for (size_t f = 0; f < p.field.faces(); ++f) {
      p.start.push_back(static_cast<int32_t>(random.Below(p.field.classes + 1)) - 1);
      if (random.Uniform() < 0.001) p.field.cell[f][random.Below(2)] += 4;
    }
    // A corner of the mesh.
    for (const Cell& cell : p.field.cell) p.core.push_back(cell[0] < 3 && cell[1] < 3);
    EXPECT_TRUE(Holds(p, LabelDependencyRadiusOf(p.options), seed, &outside)) << seed;
  }
  EXPECT_GT(outside, 40 * 1000);
}

// A chain of faces without unary costs, so that each follows the one before; its last face is the core.
//     0: face 1 is decided in the first round only if face 0 is absent.
//     1 to 4: decided or not, one per round.
//     5 to q: the messages' label becomes 1 or 0 accordingly, one face per iteration.
//     q + 1: switches from its start label 1 to 0 only if q has label 0 before and after.
//     to q + 5: follow in the even sweep, one per colour.
//     to q + 9: follow in the odd sweep.
Problem LongestChain(int iterations) {
  const int q = kDecideRounds + 1 + iterations, last = q + 9;
  Problem p;
  p.options = {.iterations = iterations, .damping = 0};
  p.field.classes = 2;
  p.field.unary.assign(2 * (last + 1), 0.0f);
  p.field.unary[2] = 4;
  for (int f = 0; f <= last; ++f) {
    p.start.push_back(f > q);
    p.core.push_back(f == last);
    if (f > 0) {
      const double weight = f == 1 ? 5 : 3 * std::pow(0.98, f);
      p.field.edges.push_back({static_cast<uint32_t>(f - 1), static_cast<uint32_t>(f), static_cast<float>(weight)});
    }
  }
  const int even[] = {2, 0, 1, 2, 3, 0, 1, 0, 1}, odd[] = {3, 1, 3, 1, 3, 0, 1, 2, 3};
  p.field.cell.assign(q + 1, CellOf(3, 2, 0));
  for (int i = 0; i < 9; ++i) p.field.cell.push_back(CellOf(even[i], odd[i], i + 1));
  return p;
}

TEST(LabelDependency, EveryBoundIsAttained) {
  for (const int iterations : {0, 1, 2, 7, 30}) {
    const Problem p = LongestChain(iterations);
    std::vector<uint32_t> faces;
    const auto kept = [&](const LabelDependencyRadius& reach) {
      return FacesInDependencyRadius(LinksOf(p.field), p.field.cell, p.core, reach);
    };
    const LabelDependencyRadius reach = LabelDependencyRadiusOf(p.options);
    EXPECT_EQ(kept(reach)[0], 1);
    std::vector<uint8_t> others(p.core.size(), 1);
    others[0] = 0;
    EXPECT_NE(CoreOf(CutDown(p, others, &faces)).first, CoreOf(p).first) << iterations;
    for (int LabelDependencyRadius::*number :
         {&LabelDependencyRadius::odd_turns, &LabelDependencyRadius::odd_rings, &LabelDependencyRadius::even_turns,
          &LabelDependencyRadius::even_links, &LabelDependencyRadius::rings}) {
      LabelDependencyRadius less = reach;
      --(less.*number);
      EXPECT_EQ(kept(less)[0], 0);
    }
  }
}

TEST(LabelDependency, EnergyNeverExceedsTheStartForAnyNumberOfThreads) {
  for (uint64_t seed = 0; seed < 500; ++seed) {
    Problem p = RandomStrip(seed);
    for (int32_t& label : p.start) label = std::max(label, 0);
    const ThreadLimit one(1);
    const Labelling single = SolveLabels(p.field, p.start, p.options);
    EXPECT_LE(LabelEnergy(p.field, single.labels), LabelEnergy(p.field, p.start) + 1e-4) << seed;
    const ThreadLimit three(3);
    const Labelling many = SolveLabels(p.field, p.start, p.options);
    EXPECT_EQ(single.labels, many.labels);
    EXPECT_EQ(single.beliefs, many.beliefs);
  }
}

// Blocks of a grid read no farther than two blocks in one direction and one in the other.
TEST(LabelDependency, ChainsOfTurnsAreShort) {
  for (const BlockGrid grid : {BlockGrid::kEven, BlockGrid::kOdd}) {
    Cell farthest = {0, 0};
    const std::function<void(const Cell&, const Cell&)> follow = [&](const Cell& from, const Cell& block) {
      for (size_t axis = 0; axis < 2; ++axis) {
        farthest[axis] = std::max(farthest[axis], std::abs(block[axis] - from[axis]));
      }
      for (int32_t i = 0; i < 9; ++i) {
        const Cell next = {block[0] + i % 3 - 1, block[1] + i / 3 - 1};
        EXPECT_EQ(ColourOf(next, grid) == ColourOf(block, grid), i == 4);
        if (ColourOf(next, grid) < ColourOf(block, grid)) follow(from, next);
      }
    };
    for (int32_t i = 0; i < 4; ++i) follow({i % 2, i / 2}, {i % 2, i / 2});
    EXPECT_EQ(farthest, grid == BlockGrid::kEven ? (Cell{2, 1}) : (Cell{1, 2}));
  }
}

TEST(LabelDependency, FacesInRadiusGrowByBlocksThenByRings) {
  // A row of faces, two per cell; blocks of four faces; the odd blocks begin at face 2.
  std::vector<std::array<uint32_t, 2>> links;
  std::vector<Cell> cell;
  for (uint32_t f = 0; f < 40; ++f) {
    cell.push_back({static_cast<int32_t>(f / 2), 0});
    if (f > 0) links.push_back({f - 1, f});
  }
  std::vector<uint8_t> core(40, 0);
  core[20] = 1;
  const auto range = [&](const LabelDependencyRadius& reach) {
    const std::vector<uint8_t> in = FacesInDependencyRadius(links, cell, core, reach);
    const auto first = std::find(in.begin(), in.end(), 1);
    const auto last = std::find(first, in.end(), 0);
    EXPECT_EQ(std::count(last, in.end(), 1), 0);
    return std::array<std::ptrdiff_t, 2>{first - in.begin(), last - in.begin()};
  };
  // Face 20 is in the odd block 18 to 21, which touches the even blocks 16 to 23. The odd blocks beside its own, and
  // the even block 24 to 27 but not 12 to 15, have their turns earlier.
  EXPECT_EQ(range({}), (std::array<std::ptrdiff_t, 2>{16, 24}));
  EXPECT_EQ(range({.odd_turns = 1}), (std::array<std::ptrdiff_t, 2>{12, 28}));
  EXPECT_EQ(range({.odd_turns = 3}), (std::array<std::ptrdiff_t, 2>{12, 28}));
  EXPECT_EQ(range({.odd_rings = 3}), (std::array<std::ptrdiff_t, 2>{12, 28}));
  EXPECT_EQ(range({.even_turns = 1}), (std::array<std::ptrdiff_t, 2>{16, 28}));
  EXPECT_EQ(range({.even_turns = 3}), (std::array<std::ptrdiff_t, 2>{16, 28}));
  EXPECT_EQ(range({.even_links = 1}), (std::array<std::ptrdiff_t, 2>{12, 28}));
  EXPECT_EQ(range({.rings = 1}), (std::array<std::ptrdiff_t, 2>{15, 25}));
}

}  // namespace
}  // namespace tessera
