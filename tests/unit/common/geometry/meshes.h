// Meshes for the tests of this folder.
#pragma once

#include <algorithm>
#include <cmath>

#include "common/base/random.h"
#include "common/geometry/mesh.h"

namespace tessera {

// columns x rows squares in the plane z = f(x, y), two triangles each, facing up.
inline TriangleMesh Grid(uint32_t columns, uint32_t rows) {
  TriangleMesh mesh;
  for (uint32_t y = 0; y <= rows; ++y)
    for (uint32_t x = 0; x <= columns; ++x) mesh.vertices.push_back({double(x), double(y), std::sin(x + 2.0 * y)});
  for (uint32_t y = 0; y < rows; ++y)
    for (uint32_t x = 0; x < columns; ++x) {
      const uint32_t a = y * (columns + 1) + x, b = a + 1, c = a + columns + 1, d = c + 1;
      mesh.faces.push_back({a, b, d});
      mesh.faces.push_back({a, d, c});
    }
  return mesh;
}

// A closed ring of n x m squares.
inline TriangleMesh Torus(uint32_t n, uint32_t m) {
  TriangleMesh mesh;
  for (uint32_t i = 0; i < n; ++i)
    for (uint32_t j = 0; j < m; ++j) {
      const double u = 2 * M_PI * i / n, v = 2 * M_PI * j / m, r = 3 + std::cos(v);
      mesh.vertices.push_back({r * std::cos(u), r * std::sin(u), std::sin(v)});
    }
  for (uint32_t i = 0; i < n; ++i)
    for (uint32_t j = 0; j < m; ++j) {
      const uint32_t a = i * m + j, b = (i + 1) % n * m + j, c = (i + 1) % n * m + (j + 1) % m, d = i * m + (j + 1) % m;
      mesh.faces.push_back({a, b, c});
      mesh.faces.push_back({a, c, d});
    }
  return mesh;
}

inline TriangleMesh Tetrahedron(const Eigen::Vector3d& at = Eigen::Vector3d::Zero()) {
  TriangleMesh mesh;
  for (const Eigen::Vector3d& p : {Eigen::Vector3d(0, 0, 0), {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}) {
    mesh.vertices.push_back(at + p);
  }
  mesh.faces = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
  return mesh;
}

// Random triangles over few vertices, which contain all defects many times.
inline TriangleMesh Chaos(uint64_t seed, int vertices, int faces) {
  Random random(seed);
  TriangleMesh mesh;
  // Few different coordinates, so that some faces have no area.
  for (int v = 0; v < vertices; ++v) {
    mesh.vertices.push_back({double(random.Below(4)), double(random.Below(4)), double(random.Below(4))});
  }
  for (int f = 0; f < faces; ++f) {
    Triangle face;
    for (uint32_t& corner : face) corner = static_cast<uint32_t>(random.Below(vertices));
    mesh.faces.push_back(face);
    mesh.labels.push_back(static_cast<int32_t>(random.Below(5)));
  }
  return mesh;
}

// A torus with a share of its faces flipped, duplicated, or given another vertex.
inline TriangleMesh DamagedTorus(uint64_t seed) {
  Random random(seed);
  TriangleMesh mesh = Torus(12, 9);
  const size_t faces = mesh.faces.size();
  for (size_t f = 0; f < faces; ++f) {
    const double dice = random.Uniform();
    if (dice < 0.03) std::swap(mesh.faces[f][0], mesh.faces[f][1]);
    if (dice > 0.97) mesh.faces.push_back(mesh.faces[f]);
    if (dice > 0.5 && dice < 0.53) mesh.faces[f][2] = static_cast<uint32_t>(random.Below(100));
    if (dice > 0.6 && dice < 0.63) mesh.faces.push_back({mesh.faces[f][0], mesh.faces[f][1], 50});
  }
  for (size_t f = 0; f < mesh.faces.size(); ++f) mesh.labels.push_back(static_cast<int32_t>(f % 3));
  return mesh;
}

}  // namespace tessera
