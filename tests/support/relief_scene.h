// A small textured relief with a wall that hides part of it, and photographs of it, all made in code.
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <vector>

#include "common/base/random.h"
#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "common/imaging/raster.h"
#include "tests/support/draw_views.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// Smooth texture with detail at several scales, values about 0.2..0.8.
inline double ReliefTexture(const Eigen::Vector3d& p) {
  double value = 0.5;
  const double direction[6][3] = {{1, 0.3, 0.5},    {-0.4, 1, 0.2}, {0.7, -0.8, 1},
                                  {0.2, 0.9, -0.6}, {1, 1, 0.3},    {-1, 0.5, 0.8}};
  const double wave_m[6] = {4.1, 2.9, 1.7, 1.3, 0.9, 0.7};
  for (int i = 0; i < 6; ++i) {
    const double phase = p.dot(Eigen::Vector3d(direction[i][0], direction[i][1], direction[i][2])) / wave_m[i];
    value += 0.05 * std::sin(6.283185307179586 * phase + i);
  }
  return value;
}

// n x n cells over [-half, half]², heights by `height(x, y)`.
template <class Height>
TriangleMesh HeightField(int n, double half_m, const Height& height) {
  TriangleMesh mesh;
  for (int y = 0; y <= n; ++y) {
    for (int x = 0; x <= n; ++x) {
      const double px = half_m * (2.0 * x / n - 1), py = half_m * (2.0 * y / n - 1);
      mesh.vertices.push_back({px, py, height(px, py)});
    }
  }
  const auto id = [&](int x, int y) { return static_cast<uint32_t>(y * (n + 1) + x); };
  for (int y = 0; y < n; ++y) {
    for (int x = 0; x < n; ++x) {
      mesh.faces.push_back({id(x, y), id(x + 1, y), id(x + 1, y + 1)});
      mesh.faces.push_back({id(x, y), id(x + 1, y + 1), id(x, y + 1)});
    }
  }
  return mesh;
}

// Gentle hills with a steep block that hides ground from oblique views.
inline double ReliefHeight(double x, double y) {
  const double block = 1 / (1 + std::exp(-8 * (1.6 - std::max(std::abs(x - 1), std::abs(y)))));
  return 0.5 * std::sin(0.9 * x) * std::cos(0.8 * y) + 2.0 * block;
}

// Camera at `centre` looking at `target`.
inline PosedCamera LookAt(const Eigen::Vector3d& centre, const Eigen::Vector3d& target, int width, int height,
                          double focal_px) {
  PosedCamera camera;
  camera.intrinsics = {width, height, focal_px, focal_px, 0.5 * width, 0.5 * height};
  const Eigen::Vector3d z = (target - centre).normalized();
  const Eigen::Vector3d x = z.cross(Eigen::Vector3d(0.05, 1, 0.02)).normalized();
  camera.rotation_cam_from_world.row(0) = x;
  camera.rotation_cam_from_world.row(1) = z.cross(x);
  camera.rotation_cam_from_world.row(2) = z;
  camera.translation_cam_from_world = -(camera.rotation_cam_from_world * centre);
  return camera;
}

inline std::vector<PosedCamera> ReliefCameras(int size_px) {
  const double focal = 1.25 * size_px;
  std::vector<PosedCamera> cameras;
  for (const Eigen::Vector3d& centre : {Eigen::Vector3d(0, 0, 14), Eigen::Vector3d(5, 1, 13),
                                        Eigen::Vector3d(-5, 3, 12.5), Eigen::Vector3d(-1, -6, 12)}) {
    cameras.push_back(LookAt(centre, Eigen::Vector3d(0, 0, 0.3), size_px, size_px * 3 / 4, focal));
  }
  return cameras;
}

// What `camera` photographs of `mesh`: texture, gain and noise; NaN where there is nothing.
inline FloatImage Photograph(const TriangleMesh& mesh, const PosedCamera& camera, double gain, double noise,
                             uint64_t seed) {
  const FaceMap map = RasterizeFaces(mesh, camera);
  Random random(seed);
  FloatImage image(map.width, map.height, 1, std::numeric_limits<float>::quiet_NaN());
  const Eigen::Vector3d centre = camera.Centre();
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      const size_t i = static_cast<size_t>(y) * map.width + x;
      if (map.face[i] < 0) continue;
      const Eigen::Vector3d p = centre + static_cast<double>(map.depth[i]) * camera.Ray(x + 0.5, y + 0.5);
      image.at(x, y) = static_cast<float>(gain * ReliefTexture(p) + noise * random.Normal());
    }
  }
  return image;
}

// How likely each of `classes` classes is at p, by the texture and the height: smooth, summing to one.
inline double ReliefLikelihood(const Eigen::Vector3d& p, int l, int classes) {
  double sum = 0, mine = 0;
  for (int k = 0; k < classes; ++k) {
    const double score = std::exp(2 * std::sin(2.1 * p.x() + 1.3 * k) * std::cos(1.7 * p.y() - 0.9 * k) +
                                  0.8 * std::sin(1.5 * p.z() + k));
    sum += score;
    if (k == l) mine = score;
  }
  return mine / sum;
}

// What a classifier makes of `camera`'s photograph of `mesh`: a plane a class; uniform where there is nothing.
inline FloatImage PhotographClasses(const TriangleMesh& mesh, const PosedCamera& camera, int classes) {
  const FaceMap map = RasterizeFaces(mesh, camera);
  FloatImage image(map.width, map.height, classes, 1 / static_cast<float>(classes));
  const Eigen::Vector3d centre = camera.Centre();
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      const size_t i = static_cast<size_t>(y) * map.width + x;
      if (map.face[i] < 0) continue;
      const Eigen::Vector3d p = centre + static_cast<double>(map.depth[i]) * camera.Ray(x + 0.5, y + 0.5);
      for (int l = 0; l < classes; ++l) image.at(x, y, l) = static_cast<float>(ReliefLikelihood(p, l, classes));
    }
  }
  return image;
}

}  // namespace tessera
