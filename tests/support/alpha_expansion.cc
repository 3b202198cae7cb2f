#include "tests/support/alpha_expansion.h"

#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"  // in Boost's max flow, as GCC 12 sees it

#include <CGAL/boost/graph/alpha_expansion_graphcut.h>

#include <algorithm>
#include <utility>

namespace tessera {

std::vector<int32_t> ExpandLabels(const LabelField& field, std::vector<int32_t> labels) {
  std::vector<std::pair<size_t, size_t>> edges;
  std::vector<double> edge_costs;
  for (const FieldEdge& e : field.edges) {
    edges.push_back({e.face0, e.face1});
    edge_costs.push_back(e.weight);
  }
  std::vector<std::vector<double>> costs(field.classes, std::vector<double>(field.faces()));
  for (size_t f = 0; f < field.faces(); ++f) {
    // The cuts take no negative costs, and only differences within a face matter.
    const float* unary = &field.unary[f * field.classes];
    const double least = *std::min_element(unary, unary + field.classes);
    for (int l = 0; l < field.classes; ++l) costs[l][f] = unary[l] - least;
  }
  std::vector<size_t> expanded(labels.begin(), labels.end());
  CGAL::alpha_expansion_graphcut(edges, edge_costs, costs, expanded, CGAL::Alpha_expansion_boost_adjacency_list_tag());
  labels.assign(expanded.begin(), expanded.end());
  return labels;
}

}  // namespace tessera
