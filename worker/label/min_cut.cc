#include "worker/label/min_cut.h"

#include <algorithm>
#include <limits>

namespace tessera {

void MinCut::Reset(int nodes) {
  cost_.assign(nodes, 0);
  pairs_.clear();
}

void MinCut::AddPair(int node0, int node1, double weight) { pairs_.push_back({node0, node1, weight}); }

void MinCut::MakeArcs() {
  const int nodes = static_cast<int>(cost_.size());
  first_.assign(nodes + 1, 0);
  for (const Pair& p : pairs_) {
    ++first_[p.node0];
    ++first_[p.node1];
  }
  for (int i = 0; i < nodes; ++i) first_[i + 1] += first_[i];
  arcs_.resize(2 * pairs_.size());
  for (const Pair& p : pairs_) {
    const int a = --first_[p.node0], b = --first_[p.node1];
    arcs_[a] = {p.node1, b, p.weight, 2 * p.weight};
    arcs_[b] = {p.node0, a, p.weight, 2 * p.weight};
  }
}

// Breadth-first search backwards from the sinks that still take flow, up to the nearest source with flow to send.
// Sets each node's distance, -1 beyond. Balls around the few remaining sinks are much smaller than the graph. Returns
// false if no source can reach a sink.
bool MinCut::FindLevels() {
  for (const int i : queue_) level_[i] = -1;
  queue_.clear();
  std::erase_if(sinks_, [&](int i) { return cost_[i] >= 0; });
  for (const int i : sinks_) {
    level_[i] = 0;
    next_[i] = first_[i];
    queue_.push_back(i);
  }
  int limit = std::numeric_limits<int>::max();
  for (size_t q = 0; q < queue_.size(); ++q) {
    const int i = queue_[q], level = level_[i] + 1;
    if (level > limit) break;
    for (int a = first_[i]; a < first_[i + 1]; ++a) {
      const Arc& arc = arcs_[a];
      if (level_[arc.to] >= 0 || arc.capacity >= arc.both) continue;
      level_[arc.to] = level;
      next_[arc.to] = first_[arc.to];
      queue_.push_back(arc.to);
      if (cost_[arc.to] > 0) limit = level;
    }
  }
  return limit != std::numeric_limits<int>::max();
}

// Depth-first: sends the excess of `source` down the levels until none is left or no path remains.
void MinCut::Push(int source) {
  path_.clear();
  int at = source;
  while (cost_[source] > 0) {
    if (level_[at] == 0 && cost_[at] < 0) {
      double flow = std::min(cost_[source], -cost_[at]);
      for (const int a : path_) flow = std::min(flow, arcs_[a].capacity);
      cost_[source] -= flow;
      cost_[at] += flow;
      for (const int a : path_) {
        arcs_[a].capacity -= flow;
        arcs_[arcs_[a].reverse].capacity = arcs_[a].both - arcs_[a].capacity;
      }
      // Resume before the first arc that is now saturated.
      size_t keep = 0;
      while (keep < path_.size() && arcs_[path_[keep]].capacity > 0) ++keep;
      if (keep < path_.size()) {
        at = arcs_[arcs_[path_[keep]].reverse].to;
        path_.resize(keep);
      }
      continue;
    }
    int& a = next_[at];
    while (a < first_[at + 1] && !(arcs_[a].capacity > 0 && level_[arcs_[a].to] == level_[at] - 1)) ++a;
    if (level_[at] > 0 && a < first_[at + 1]) {
      path_.push_back(a);
      at = arcs_[a].to;
    } else {
      level_[at] = -1;
      if (path_.empty()) break;
      at = arcs_[arcs_[path_.back()].reverse].to;
      path_.pop_back();
    }
  }
}

void MinCut::Solve() {
  MakeArcs();
  const int nodes = static_cast<int>(cost_.size());
  level_.assign(nodes, -1);
  next_.resize(nodes);
  queue_.clear();
  sinks_.clear();
  for (int i = 0; i < nodes; ++i) {
    if (cost_[i] < 0) sinks_.push_back(i);
  }
  // When no source can send any more, x is 1 for the nodes that can still reach a sink with capacity left.
  while (FindLevels()) {
    for (const int i : queue_) {
      if (cost_[i] > 0) Push(i);
    }
  }
}

}  // namespace tessera
