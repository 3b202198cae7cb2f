#include "worker/refine/one_rings.h"

#include <algorithm>
#include <array>
#include <numeric>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 4096;

}  // namespace

CsrRows FacesOfVertices(const TriangleMesh& mesh) {
  CsrRows rows;
  rows.offsets.assign(mesh.vertices.size() + 1, 0);
  for (const Triangle& face : mesh.faces) {
    for (uint32_t v : face) ++rows.offsets[v + 1];
  }
  std::partial_sum(rows.offsets.begin(), rows.offsets.end(), rows.offsets.begin());
  rows.items.resize(static_cast<size_t>(rows.offsets.back()));
  std::vector<int64_t> next(rows.offsets.begin(), rows.offsets.end() - 1);
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    for (uint32_t v : mesh.faces[f]) rows.items[static_cast<size_t>(next[v]++)] = static_cast<uint32_t>(f);
  }
  return rows;
}

OneRings FindOneRings(const TriangleMesh& mesh, const CsrRows& faces_of_vertex) {
  const size_t n = mesh.vertices.size();
  OneRings rings;
  // The ends of every face's edges at each vertex. Sorted, they make all later sums independent of the order of faces.
  std::vector<uint32_t> ends(2 * faces_of_vertex.items.size());
  const auto first = [&](size_t v) { return 2 * static_cast<size_t>(faces_of_vertex.offsets[v]); };
  rings.begin.assign(n + 1, 0);
  rings.on_boundary.assign(n, 0);
  rings.along_boundary.resize(n);
  // Calls body(neighbour, faces at the edge) for the neighbours of v, ascending.
  const auto for_neighbours = [&](size_t v, const auto& body) {
    for (size_t i = first(v); i < first(v + 1);) {
      size_t end = i;
      while (end < first(v + 1) && ends[end] == ends[i]) ++end;
      body(ends[i], static_cast<uint32_t>(end - i));
      i = end;
    }
  };
  ParallelForEach(n, kGrain, [&](size_t v) {
    uint32_t* const begin = ends.data() + first(v);
    uint32_t* end = begin;
    for (const uint32_t f : faces_of_vertex[v]) {
      const Triangle& face = mesh.faces[f];
      const int k = CornerOf(face, v);
      *end++ = face[(k + 1) % 3];
      *end++ = face[(k + 2) % 3];
    }
    std::sort(begin, end);
    std::array<uint32_t, 2> along = {static_cast<uint32_t>(v), static_cast<uint32_t>(v)};
    int rim_edges = 0;
    for_neighbours(v, [&](uint32_t neighbour, uint32_t faces) {
      ++rings.begin[v + 1];
      if (faces == 2) return;
      rings.on_boundary[v] = 1;
      if (rim_edges < 2) along[rim_edges] = neighbour;
      ++rim_edges;
    });
    if (rim_edges != 2) along = {static_cast<uint32_t>(v), static_cast<uint32_t>(v)};
    rings.along_boundary[v] = along;
  });
  std::partial_sum(rings.begin.begin(), rings.begin.end(), rings.begin.begin());
  rings.to.resize(rings.begin[n]);
  rings.inner.resize(rings.begin[n]);
  ParallelForEach(n, kGrain, [&](size_t v) {
    uint32_t at = rings.begin[v];
    for_neighbours(v, [&](uint32_t neighbour, uint32_t faces) {
      rings.to[at] = neighbour;
      rings.inner[at++] = faces == 2;
    });
  });
  return rings;
}

}  // namespace tessera
