#include "worker/label/min_cut.h"

#include <gtest/gtest.h>

#include <bit>
#include <limits>
#include <vector>

#include "common/base/random.h"

namespace tessera {
namespace {

struct Pair {
  int node0, node1;
  double weight;
};

TEST(MinCut, FindsTheMinimiserWithTheFewestOnes) {
  MinCut cut;
  for (uint64_t seed = 0; seed < 300; ++seed) {
    Random random(seed);
    const int nodes = 1 + static_cast<int>(random.Below(10));
    // Integers, so that there are ties.
    std::vector<double> costs(nodes);
    for (double& c : costs) c = static_cast<double>(random.Below(9) - 4);
    std::vector<Pair> pairs;
    for (int i = 0; nodes > 1 && i < 2 * nodes; ++i) {
      const int a = static_cast<int>(random.Below(nodes)), b = static_cast<int>(random.Below(nodes));
      if (a != b) pairs.push_back({a, b, static_cast<double>(random.Below(4))});
    }
    double least = std::numeric_limits<double>::infinity();
    unsigned best = 0;
    for (unsigned set = 0; set < 1u << nodes; ++set) {
      double energy = 0;
      for (int i = 0; i < nodes; ++i) energy += set >> i & 1 ? costs[i] : 0;
      for (const Pair& p : pairs) energy += (set >> p.node0 & 1) != (set >> p.node1 & 1) ? p.weight : 0;
      if (energy < least || (energy == least && std::popcount(set) < std::popcount(best))) {
        least = energy;
        best = set;
      }
    }
    cut.Reset(nodes);
    for (int i = 0; i < nodes; ++i) cut.AddCost(i, costs[i]);
    for (const Pair& p : pairs) cut.AddPair(p.node0, p.node1, p.weight);
    cut.Solve();
    unsigned found = 0;
    for (int i = 0; i < nodes; ++i) found |= cut.Selected(i) ? 1u << i : 0;
    EXPECT_EQ(found, best) << seed;
  }
}

}  // namespace
}  // namespace tessera
