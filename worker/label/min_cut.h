// Least cuts of small graphs.
#ifndef TESSERA_WORKER_LABEL_MIN_CUT_H_
#define TESSERA_WORKER_LABEL_MIN_CUT_H_

#include <cstdint>
#include <vector>

namespace tessera {

// Minimises Σ_i cost_i x_i + Σ_pairs weight [x_i != x_j] over x in {0, 1} (Dinic's maximum flow). Meant to be used
// again and again: it keeps its memory.
class MinCut {
 public:
  // Forgets what was there.
  void Reset(int nodes);
  void AddCost(int node, double cost) { cost_[node] += cost; }
  // weight >= 0.
  void AddPair(int node0, int node1, double weight);
  // After it, In(node) is x of the minimiser with the fewest ones.
  void Solve();
  bool In(int node) const { return level_[node] >= 0; }

 private:
  struct Pair {
    int node0, node1;
    double weight;
  };
  struct Arc {
    int to, reverse;
    double capacity, both;  // what is left this way, and in both together
  };
  void MakeArcs();
  bool FindLevels();
  void Push(int source);

  std::vector<double> cost_;  // positive: what may still flow in; negative: what may still flow out
  std::vector<Pair> pairs_;
  std::vector<int> first_, next_, level_, queue_, path_, sinks_;
  std::vector<Arc> arcs_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_LABEL_MIN_CUT_H_
