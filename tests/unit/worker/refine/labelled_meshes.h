// Labelled meshes for tests of the regularisers, and a derivative check.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "common/base/random.h"
#include "tests/support/relief_scene.h"
#include "tests/unit/common/geometry/meshes.h"

namespace tessera {

using Positions = std::vector<Eigen::Vector3d>;

inline Eigen::Vector3d RandomVector(Random& random) { return {random.Normal(), random.Normal(), random.Normal()}; }

// Flips edge (k, k + 1) of `face` if the result is manifold.
inline void FlipEdge(TriangleMesh* mesh, size_t face, int k) {
  const uint32_t a = mesh->faces[face][k], b = mesh->faces[face][(k + 1) % 3], c = mesh->faces[face][(k + 2) % 3];
  const auto has_edge = [&](uint32_t p, uint32_t q) {
    return std::any_of(mesh->faces.begin(), mesh->faces.end(), [&](const Triangle& t) {
      return std::count(t.begin(), t.end(), p) && std::count(t.begin(), t.end(), q);
    });
  };
  for (Triangle& other : mesh->faces) {
    for (int j = 0; j < 3; ++j) {
      const uint32_t d = other[(j + 2) % 3];
      if (other[j] != b || other[(j + 1) % 3] != a || has_edge(c, d)) continue;
      mesh->faces[face] = {c, a, d};
      other = {d, b, c};
      return;
    }
  }
}

// Bumpy meshes with irregular degrees. seed % 3: 0 closed, 1 with one boundary, 2 with holes. Labels form patches of
// 0..3 plus single faces, so that there are straight and bent borders, points of three labels, and disconnected fans.
inline TriangleMesh RandomLabelledMesh(uint64_t seed) {
  Random random(seed);
  TriangleMesh mesh = seed % 3 == 0 ? Torus(10, 8) : HeightField(9, 4, [](double x, double y) { return 0.1 * x * y; });
  for (Eigen::Vector3d& p : mesh.vertices) p += 0.12 * RandomVector(random);
  for (int i = 0; i < 60; ++i) {
    FlipEdge(&mesh, random.Below(static_cast<int64_t>(mesh.faces.size())), static_cast<int>(random.Below(3)));
  }
  if (seed % 3 == 2) mesh.faces.erase(mesh.faces.begin() + 70, mesh.faces.begin() + 75);
  const Eigen::Vector3d across = RandomVector(random), along = RandomVector(random);
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Eigen::Vector3d centre = (mesh.Corner(f, 0) + mesh.Corner(f, 1) + mesh.Corner(f, 2)) / 3;
    int32_t label = (centre.dot(across) > 0 ? 1 : 0) + (centre.dot(along) > 0.5 ? 2 : 0);
    if (random.Uniform() < 0.04) label = static_cast<int32_t>(random.Below(4));
    mesh.labels.push_back(label);
  }
  return mesh;
}

inline std::vector<uint8_t> SomeFixed(const TriangleMesh& mesh, uint64_t seed) {
  Random random(seed + 77);
  std::vector<uint8_t> fixed(mesh.vertices.size());
  for (uint8_t& f : fixed) f = random.Uniform() < 0.1;
  return fixed;
}

// Largest difference between `gradient` and central differences of `energy` over free vertices, relative to the
// largest derivative.
inline double DerivativeError(const std::function<double(const Positions&)>& energy, const Positions& gradient,
                              Positions v, const std::vector<uint8_t>& fixed, double h) {
  double error = 0, largest = 0;
  for (size_t k = 0; k < v.size(); ++k) {
    if (!fixed.empty() && fixed[k]) continue;
    for (int axis = 0; axis < 3; ++axis) {
      const double at = v[k][axis];
      v[k][axis] = at + h;
      const double up = energy(v);
      v[k][axis] = at - h;
      const double down = energy(v);
      v[k][axis] = at;
      error = std::max(error, std::abs(gradient[k][axis] - (up - down) / (2 * h)));
      largest = std::max(largest, std::abs(up - down) / (2 * h));
    }
  }
  return error / largest;
}

}  // namespace tessera
