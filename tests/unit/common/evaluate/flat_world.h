// A horizontal square with cameras above it, whose scores can be computed by hand.
#pragma once

#include <string>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/scene/scene.h"

namespace tessera {

// `cells` x `cells` squares of two faces over [0, side_m]^2 at height `z`, moved by `origin`; class 0 where x is below
// half, 1 above.
inline TriangleMesh FlatSquare(double side_m, int cells, double z, const Eigen::Vector3d& origin = {0, 0, 0}) {
  TriangleMesh mesh;
  for (int y = 0; y <= cells; ++y) {
    for (int x = 0; x <= cells; ++x) {
      mesh.vertices.push_back(origin + Eigen::Vector3d(x * side_m / cells, y * side_m / cells, z));
    }
  }
  const auto at = [cells](int x, int y) { return static_cast<uint32_t>(y * (cells + 1) + x); };
  for (int y = 0; y < cells; ++y) {
    for (int x = 0; x < cells; ++x) {
      mesh.faces.push_back({at(x, y), at(x + 1, y), at(x + 1, y + 1)});
      mesh.faces.push_back({at(x, y), at(x + 1, y + 1), at(x, y + 1)});
      mesh.labels.insert(mesh.labels.end(), 2, 2 * x >= cells ? 1 : 0);
    }
  }
  return mesh;
}

// Looks straight down from (x, y, height), x right and y up in a square picture that shows `side_m` at z = 0.
inline SceneView ViewFromAbove(const Eigen::Vector3d& position, double side_m, int pixels, int index = 0) {
  SceneView view;
  view.name = std::to_string(index) + ".png";
  const double focal = pixels * position.z() / side_m;
  view.camera.intrinsics = {pixels, pixels, focal, focal, 0.5 * pixels, 0.5 * pixels};
  view.camera.rotation_cam_from_world = Eigen::Vector3d(1, -1, -1).asDiagonal();
  view.camera.translation_cam_from_world = -(view.camera.rotation_cam_from_world * position);
  view.lens.pinhole = view.camera.intrinsics;
  return view;
}

}  // namespace tessera
