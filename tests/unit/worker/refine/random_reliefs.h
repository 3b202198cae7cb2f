// Random meshes, and submeshes within a dependency radius, for tests of what a vertex's result depends on.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <vector>

#include "common/base/random.h"
#include "tests/unit/worker/refine/labelled_meshes.h"
#include "worker/refine/descent.h"

namespace tessera {

using Eigen::Vector3d;

inline bool Chance(Random& random, double share) { return random.Uniform() < share; }
// Log-uniform between `low` and `high`.
inline double Magnitude(Random& random, double low, double high) {
  return std::exp(random.Uniform(std::log(low), std::log(high)));
}

// A rough grid of nx x ny cells of one metre, with flipped edges, holes, and vertices displaced beyond their
// neighbours.
inline TriangleMesh RandomRelief(int nx, int ny, Random& random) {
  TriangleMesh mesh;
  const double rough = random.Uniform(0.05, 0.4), folded = random.Uniform(0, 0.1);
  for (int y = 0; y <= ny; ++y) {
    for (int x = 0; x <= nx; ++x) {
      mesh.vertices.push_back(Vector3d(x, y, std::sin(0.7 * x) * std::cos(0.4 * y)) + rough * RandomVector(random));
      if (Chance(random, folded)) mesh.vertices.back() += 2 * RandomVector(random);
    }
  }
  const auto id = [&](int x, int y) { return static_cast<uint32_t>(y * (nx + 1) + x); };
  const double holes = Chance(random, 0.5) ? 0.01 : 0;
  for (int y = 0; y < ny; ++y) {
    for (int x = 0; x < nx; ++x) {
      const uint32_t a = id(x, y), b = id(x + 1, y), c = id(x + 1, y + 1), d = id(x, y + 1);
      const bool turned = Chance(random, 0.5);
      if (!Chance(random, holes)) mesh.faces.push_back(turned ? Triangle{b, c, d} : Triangle{a, b, c});
      if (!Chance(random, holes)) mesh.faces.push_back(turned ? Triangle{d, a, b} : Triangle{c, d, a});
    }
  }
  const int patch = 1 + static_cast<int>(random.Below(9));
  const double alone = random.Uniform(0, 0.1);
  for (const Triangle& face : mesh.faces) {
    const Vector3d& at = mesh.vertices[face[0]];
    const auto cell = static_cast<int32_t>(std::floor(at.x() / patch) + 3 * std::floor(at.y() / patch));
    mesh.labels.push_back(Chance(random, alone) ? static_cast<int32_t>(random.Below(5)) - 1 : ((cell % 4) + 4) % 4);
  }
  return mesh;
}

// Narrow reliefs are long, so that large radii end inside them.
inline TriangleMesh RandomRelief(Random& random, int longest) {
  const int ny = 2 + static_cast<int>(random.Below(Chance(random, 0.5) ? 4 : 30));
  return RandomRelief(std::min(longest, 10 + 600 / ny), ny, random);
}

// Distance in edges from the flagged vertices; a large number if not connected.
inline std::vector<int> RingsFrom(const std::vector<Triangle>& faces, const CsrRows& faces_of_vertex,
                                  const std::vector<uint8_t>& from) {
  std::vector<int> rings(from.size(), std::numeric_limits<int>::max());
  std::vector<uint32_t> front;
  for (uint32_t v = 0; v < from.size(); ++v) {
    if (!from[v]) continue;
    rings[v] = 0;
    front.push_back(v);
  }
  for (int ring = 1; !front.empty(); ++ring) {
    std::vector<uint32_t> next;
    for (uint32_t v : front) {
      for (uint32_t f : faces_of_vertex[v]) {
        for (uint32_t w : faces[f]) {
          if (rings[w] <= ring) continue;
          rings[w] = ring;
          next.push_back(w);
        }
      }
    }
    front = std::move(next);
  }
  return rings;
}

inline std::vector<uint8_t> FacesWithin(const std::vector<Triangle>& faces, const std::vector<int>& rings, int most) {
  std::vector<uint8_t> out(faces.size());
  for (size_t f = 0; f < faces.size(); ++f) {
    out[f] = std::any_of(faces[f].begin(), faces[f].end(), [&](uint32_t v) { return rings[v] <= most; });
  }
  return out;
}

inline std::vector<uint8_t> CornersOf(const std::vector<Triangle>& faces, const std::vector<uint8_t>& flags,
                                      size_t vertices) {
  std::vector<uint8_t> out(vertices);
  for (size_t f = 0; f < faces.size(); ++f) {
    for (uint32_t v : faces[f]) out[v] |= flags[f];
  }
  return out;
}

inline std::vector<uint8_t> RandomCore(const TriangleMesh& mesh, const CsrRows& faces_of_vertex, Random& random) {
  std::vector<uint8_t> seed(mesh.vertices.size());
  seed[static_cast<size_t>(random.Below(static_cast<int64_t>(seed.size())))] = 1;
  const std::vector<int> rings = RingsFrom(mesh.faces, faces_of_vertex, seed);
  const auto size = static_cast<int>(random.Below(4));
  for (size_t v = 0; v < seed.size(); ++v) seed[v] = rings[v] <= size;
  return seed;
}

// The flagged faces and their vertices, in the same order.
struct Part {
  std::vector<uint32_t> vertices, faces;  // indices in the whole mesh

  Part(const TriangleMesh& mesh, const std::vector<uint8_t>& flags) {
    const std::vector<uint8_t> corners = CornersOf(mesh.faces, flags, mesh.vertices.size());
    for (uint32_t v = 0; v < corners.size(); ++v) {
      if (corners[v]) vertices.push_back(v);
    }
    for (uint32_t f = 0; f < flags.size(); ++f) {
      if (flags[f]) faces.push_back(f);
    }
  }
  template <class Value>
  std::vector<Value> OfVertices(const std::vector<Value>& of_whole) const {
    std::vector<Value> out;
    for (uint32_t v : vertices) out.push_back(of_whole[v]);
    return out;
  }
  TriangleMesh Mesh(const TriangleMesh& whole) const {
    TriangleMesh out;
    out.vertices = OfVertices(whole.vertices);
    for (uint32_t f : faces) {
      Triangle face = whole.faces[f];
      for (uint32_t& v : face) {
        v = static_cast<uint32_t>(std::lower_bound(vertices.begin(), vertices.end(), v) - vertices.begin());
      }
      out.faces.push_back(face);
      if (!whole.labels.empty()) out.labels.push_back(whole.labels[f]);
    }
    return out;
  }
};

inline bool SameBytes(const Vector3d& a, const Vector3d& b) {
  return std::memcmp(a.data(), b.data(), sizeof(Vector3d)) == 0;
}

// Number of flagged vertices whose values differ. `part`: the part that `values` belongs to; null: the whole.
inline int64_t Differences(const Positions& whole, const Positions& values, const Part* part,
                           const std::vector<uint8_t>& core) {
  int64_t count = 0;
  for (size_t i = 0; i < values.size(); ++i) {
    const size_t v = part ? part->vertices[i] : i;
    count += core[v] && !SameBytes(whole[v], values[i]);
  }
  return count;
}

}  // namespace tessera
