// Meshes with the faults of other programs: unwelded borders, mixed orientations; and views of a mesh.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "common/geometry/mesh.h"
#include "common/geometry/repair.h"

namespace tessera {

// Each face has vertices of its own.
inline TriangleMesh Soup(const TriangleMesh& mesh) {
  TriangleMesh soup;
  soup.labels = mesh.labels;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const auto v = static_cast<uint32_t>(soup.vertices.size());
    for (int k = 0; k < 3; ++k) soup.vertices.push_back(mesh.Corner(f, k));
    soup.faces.push_back({v, v + 1, v + 2});
  }
  return soup;
}

// The mesh in `count` tiles along x, one after another, each with vertices of its own.
inline TriangleMesh Tiles(const TriangleMesh& mesh, int count) {
  double low = 1e300, high = -1e300;
  for (const Eigen::Vector3d& p : mesh.vertices) {
    low = std::min(low, p.x());
    high = std::max(high, p.x());
  }
  TriangleMesh out;
  for (int tile = 0; tile < count; ++tile) {
    std::map<uint32_t, uint32_t> ids;
    for (size_t f = 0; f < mesh.faces.size(); ++f) {
      const double x = MeshSpans(mesh).Centroid(f).x();
      if (std::min(count - 1, static_cast<int>((x - low) / (high - low) * count)) != tile) continue;
      Triangle face;
      for (int k = 0; k < 3; ++k) {
        const auto [it, is_new] = ids.try_emplace(mesh.faces[f][k], static_cast<uint32_t>(out.vertices.size()));
        if (is_new) out.vertices.push_back(mesh.Corner(f, k));
        face[k] = it->second;
      }
      out.faces.push_back(face);
      if (!mesh.labels.empty()) out.labels.push_back(mesh.labels[f]);
    }
  }
  return out;
}

// A band of `n` squares with a half turn, which has one side only.
inline TriangleMesh MoebiusStrip(uint32_t n) {
  TriangleMesh mesh;
  for (uint32_t i = 0; i < n; ++i) {
    const double u = 2 * M_PI * i / n;
    for (const double w : {-1.0, 1.0}) {
      const double r = 5 + w * std::cos(u / 2);
      mesh.vertices.push_back({r * std::cos(u), r * std::sin(u), w * std::sin(u / 2)});
    }
  }
  for (uint32_t i = 0; i < n; ++i) {
    const bool last = i + 1 == n;
    const uint32_t a = 2 * i, b = a + 1, c = last ? 1 : a + 2, d = last ? 0 : a + 3;
    mesh.faces.push_back({a, c, b});
    mesh.faces.push_back({b, c, d});
  }
  return mesh;
}

// Eight views around the mesh, from above, which look at its middle.
inline RepairOptions ViewsAround(const TriangleMesh& mesh) {
  RepairOptions options;
  Eigen::AlignedBox3d box(Eigen::Vector3d(0, 0, 0));
  for (const Eigen::Vector3d& p : mesh.vertices) box.extend(p);
  const double radius = box.diagonal().norm() + 1;
  for (int i = 0; i < 8; ++i) {
    Viewpoint view;
    view.centre = box.center() + radius * Eigen::Vector3d(std::cos(0.8 * i), std::sin(0.8 * i), 1.5);
    const Eigen::Vector3d z = (box.center() - view.centre).normalized(), x = z.unitOrthogonal(), y = z.cross(x);
    Eigen::Matrix3d rotation, calibration;
    rotation << x.transpose(), y.transpose(), z.transpose();
    calibration << 500, 0, 400, 0, 500, 400, 0, 0, 1;
    view.projection << calibration * rotation, -calibration * rotation * view.centre;
    view.width_px = view.height_px = 800;
    view.focal_product_px2 = 250000;
    options.views.push_back(view);
  }
  return options;
}

}  // namespace tessera
