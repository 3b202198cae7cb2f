// A synthetic town for change detection: ground with boxes, rendered and classified from above.
#pragma once

#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "common/base/random.h"
#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "common/job/ground.h"
#include "tests/support/draw_views.h"
#include "worker/changes/change_view.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// Classes: 0 ground, 1 facade, 2 roof, 3 vegetation.
struct TownBox {
  double x0, y0, x1, y1, height_m;
  int32_t top_label = 2;
};

inline void AddQuad(TriangleMesh* mesh, const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                    const Eigen::Vector3d& d, int32_t label) {
  const auto first = static_cast<uint32_t>(mesh->vertices.size());
  mesh->vertices.insert(mesh->vertices.end(), {a, b, c, d});
  mesh->faces.push_back({first, first + 1, first + 2});
  mesh->faces.push_back({first, first + 2, first + 3});
  mesh->labels.insert(mesh->labels.end(), {label, label});
}

// The town's centre, placed so that its 80 x 80 cells of 0.5 m are in one block.
inline const Eigen::Vector3d kTownMiddle(24, 24, 0);

// Ground of 40 x 40 m at height 0 with boxes, whose coordinates are relative to the town's centre.
inline TriangleMesh PaintedTown(const std::vector<TownBox>& boxes) {
  TriangleMesh mesh;
  AddQuad(&mesh, {-20, -20, 0}, {20, -20, 0}, {20, 20, 0}, {-20, 20, 0}, 0);
  for (const TownBox& b : boxes) {
    const double h = b.height_m;
    AddQuad(&mesh, {b.x0, b.y0, h}, {b.x1, b.y0, h}, {b.x1, b.y1, h}, {b.x0, b.y1, h}, b.top_label);
    AddQuad(&mesh, {b.x0, b.y0, 0}, {b.x1, b.y0, 0}, {b.x1, b.y0, h}, {b.x0, b.y0, h}, 1);
    AddQuad(&mesh, {b.x1, b.y0, 0}, {b.x1, b.y1, 0}, {b.x1, b.y1, h}, {b.x1, b.y0, h}, 1);
    AddQuad(&mesh, {b.x1, b.y1, 0}, {b.x0, b.y1, 0}, {b.x0, b.y1, h}, {b.x1, b.y1, h}, 1);
    AddQuad(&mesh, {b.x0, b.y1, 0}, {b.x0, b.y0, 0}, {b.x0, b.y0, h}, {b.x0, b.y1, h}, 1);
  }
  for (Eigen::Vector3d& p : mesh.vertices) p += kTownMiddle;
  return mesh;
}

inline constexpr double kTownGsd_m = 0.2;

// A nadir camera at (x, y) from the town's centre and 40 m height, 240 x 180 pixels: 48 x 36 m of ground.
inline PosedCamera Overhead(double x, double y) {
  PosedCamera camera;
  camera.intrinsics = {240, 180, 200, 200, 120, 90};
  camera.rotation_cam_from_world << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  camera.translation_cam_from_world = -camera.rotation_cam_from_world * (kTownMiddle + Eigen::Vector3d(x, y, 40));
  return camera;
}

inline std::vector<PosedCamera> TownFlight() {
  std::vector<PosedCamera> cameras;
  for (const double y : {-8.0, 0.0, 8.0}) {
    for (const double x : {-9.0, 9.0}) cameras.push_back(Overhead(x, y + 0.05 * x));
  }
  return cameras;
}

// Texture with detail of half a metre and coarser, values about 0.2 to 0.8.
inline double TownTexture(const Eigen::Vector3d& p) {
  double value = 0.5;
  const double direction[8][3] = {{1, 0.3, 0.5}, {-0.4, 1, 0.2}, {0.7, -0.8, 1}, {0.2, 0.9, -0.6},
                                  {1, 1, 0.3},   {-1, 0.5, 0.8}, {0.9, 0.1, -1}, {-0.2, 1, 0.9}};
  const double wave_m[8] = {5.3, 3.7, 2.3, 1.7, 1.3, 1.1, 0.83, 0.61};
  for (int i = 0; i < 8; ++i) {
    const double phase = p.dot(Eigen::Vector3d(direction[i][0], direction[i][1], direction[i][2])) / wave_m[i];
    value += 0.06 * std::sin(6.283185307179586 * phase + 1.7 * i);
  }
  return value;
}

// Renders `mesh` with noise: images, and likelihoods of 0.7 for the true class.
inline std::vector<ChangeView> Photographs(const TriangleMesh& mesh, const std::vector<PosedCamera>& cameras,
                                           int classes = 4) {
  std::vector<ChangeView> views;
  Random random(7);
  for (const PosedCamera& camera : cameras) {
    const FaceMap map = RasterizeFaces(mesh, camera);
    ChangeView view;
    view.camera = camera;
    view.luminance = FloatImage(map.width, map.height, 1, std::numeric_limits<float>::quiet_NaN());
    if (classes > 0) view.likelihoods = FloatImage(map.width, map.height, classes, 1 / static_cast<float>(classes));
    for (int y = 0; y < map.height; ++y) {
      for (int x = 0; x < map.width; ++x) {
        const size_t i = static_cast<size_t>(y) * map.width + x;
        if (map.face[i] < 0) continue;
        const Eigen::Vector3d p = camera.Centre() + static_cast<double>(map.depth[i]) * camera.Ray(x + 0.5, y + 0.5);
        view.luminance.at(x, y) = static_cast<float>(TownTexture(p) + 0.01 * random.Normal());
        for (int c = 0; c < classes; ++c) {
          view.likelihoods.at(x, y, c) = mesh.labels[map.face[i]] == c ? 0.7f : 0.3f / static_cast<float>(classes - 1);
        }
      }
    }
    views.push_back(std::move(view));
  }
  return views;
}

}  // namespace tessera
