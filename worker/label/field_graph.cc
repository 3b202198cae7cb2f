#include "worker/label/field_graph.h"

#include <numeric>

namespace tessera {

FieldGraph MakeFieldGraph(const LabelField& field) {
  FieldGraph graph;
  graph.offsets.assign(field.faces() + 1, 0);
  for (const FieldEdge& e : field.edges) {
    if (e.weight == 0) continue;
    ++graph.offsets[e.face0];
    ++graph.offsets[e.face1];
  }
  // Offsets first hold the end of each face's links; filling backwards turns them into the begin.
  std::partial_sum(graph.offsets.begin(), graph.offsets.end(), graph.offsets.begin());
  graph.links.resize(graph.offsets.back());
  for (uint32_t i = static_cast<uint32_t>(field.edges.size()); i-- > 0;) {
    const FieldEdge& e = field.edges[i];
    if (e.weight == 0) continue;
    graph.links[--graph.offsets[e.face0]] = {e.face1, e.weight, i};
    graph.links[--graph.offsets[e.face1]] = {e.face0, e.weight, i};
  }
  return graph;
}

}  // namespace tessera
