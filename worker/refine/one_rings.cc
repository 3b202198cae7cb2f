#include "worker/refine/one_rings.h"

#include <algorithm>
#include <numeric>

namespace tessera {

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

OneRings FindOneRings(const TriangleMesh& mesh) {
  const size_t n = mesh.vertices.size();
  OneRings rings;
  // Both directions of every face's edges, bucketed by their first vertex. Counting sort instead of maps keeps this
  // linear, and sorted neighbours make all later sums independent of the order of faces.
  std::vector<uint32_t> first(n + 1, 0);
  for (const Triangle& face : mesh.faces) {
    for (uint32_t v : face) first[v + 1] += 2;
  }
  for (size_t v = 0; v < n; ++v) first[v + 1] += first[v];
  std::vector<uint32_t> ends(first[n]), next(first.begin(), first.end() - 1);
  for (const Triangle& face : mesh.faces) {
    for (int k = 0; k < 3; ++k) {
      const uint32_t a = face[k], b = face[(k + 1) % 3];
      ends[next[a]++] = b;
      ends[next[b]++] = a;
    }
  }
  rings.begin.assign(n + 1, 0);
  rings.on_boundary.assign(n, 0);
  rings.along_boundary.resize(n);
  rings.to.reserve(ends.size() / 2);
  rings.inner.reserve(ends.size() / 2);
  for (size_t v = 0; v < n; ++v) {
    std::sort(ends.begin() + first[v], ends.begin() + first[v + 1]);
    std::array<uint32_t, 2> along = {static_cast<uint32_t>(v), static_cast<uint32_t>(v)};
    int rim_edges = 0;
    for (uint32_t i = first[v]; i < first[v + 1];) {
      uint32_t end = i;
      while (end < first[v + 1] && ends[end] == ends[i]) ++end;
      const bool inner = end - i == 2;
      if (!inner) {
        rings.on_boundary[v] = 1;
        if (rim_edges < 2) along[rim_edges] = ends[i];
        ++rim_edges;
      }
      rings.to.push_back(ends[i]);
      rings.inner.push_back(inner);
      i = end;
    }
    if (rim_edges != 2) along = {static_cast<uint32_t>(v), static_cast<uint32_t>(v)};
    rings.along_boundary[v] = along;
    rings.begin[v + 1] = static_cast<uint32_t>(rings.to.size());
  }
  return rings;
}

}  // namespace tessera
