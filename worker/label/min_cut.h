// Minimum cuts of small graphs.
#pragma once

#include <vector>

namespace tessera {

// Minimises Σ_i cost_i x_i + Σ_pairs weight [x_i != x_j] over x in {0, 1} with Dinic's maximum flow. Reuses its
// buffers.
class MinCut {
 public:
  // Clears the graph and sets its number of nodes, all of cost 0.
  void Reset(int nodes);
  void AddCost(int node, double cost) { cost_[node] += cost; }
  // Requires weight >= 0.
  void AddPair(int node0, int node1, double weight);
  // After Solve, Selected(node) is x of that minimiser with the fewest ones.
  void Solve();
  bool Selected(int node) const { return level_[node] >= 0; }

 private:
  struct Pair {
    int node0, node1;
    double weight;
  };
  struct Arc {
    int to, reverse;
    double capacity, both;  // residual capacity of this arc, and of both directions together
  };
  void MakeArcs();
  bool FindLevels();
  void Push(int source);

  std::vector<double> cost_;  // > 0: excess left to send; < 0: capacity left to receive
  std::vector<Pair> pairs_;
  std::vector<int> first_, next_, level_, queue_, path_, sinks_;
  std::vector<Arc> arcs_;
};

}  // namespace tessera
