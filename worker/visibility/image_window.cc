#include "worker/visibility/image_window.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/base/parallel.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

constexpr int64_t kGrain = 4096;

// A vertex as a camera sees it: pixel coordinates and 1/z, which is linear over the image of a plane.
struct Corner {
  double x = 0, y = 0;
  double inverse_z = 0;  // not positive: nearer than the near plane, x and y mean nothing
};

struct ProjectedMesh {
  std::vector<Corner> corners;
  std::vector<Vector3d> in_camera;
};

Corner ToCorner(const PinholeCamera& k, const Vector3d& p) {
  const double inverse_z = 1 / p.z();
  return {k.fx * p.x() * inverse_z + k.cx, k.fy * p.y() * inverse_z + k.cy, inverse_z};
}

ProjectedMesh ProjectVertices(const TriangleMesh& mesh, const PosedCamera& camera, double near_m) {
  ProjectedMesh out;
  out.corners.resize(mesh.vertices.size());
  out.in_camera.resize(mesh.vertices.size());
  ParallelFor(static_cast<int64_t>(mesh.vertices.size()), kGrain, [&](int64_t begin, int64_t end) {
    for (int64_t v = begin; v < end; ++v) {
      out.in_camera[v] = camera.CameraFromWorld(mesh.vertices[v]);
      out.corners[v] = out.in_camera[v].z() >= near_m ? ToCorner(camera.intrinsics, out.in_camera[v]) : Corner();
    }
  });
  return out;
}

// A face's outline after near clipping: 3 or 4 corners, or none.
struct Outline {
  int count = 0;
  std::array<Corner, 4> corner;
};

Outline MakeOutline(const Triangle& face, const ProjectedMesh& projected, const PinholeCamera& k, double near_m) {
  Outline out;
  int behind = 0;
  for (uint32_t v : face) behind += projected.corners[v].inverse_z <= 0;
  if (behind == 3) return out;
  if (behind == 0) {
    out.count = 3;
    for (int i = 0; i < 3; ++i) out.corner[i] = projected.corners[face[i]];
    return out;
  }
  for (int i = 0; i < 3; ++i) {
    const uint32_t a = face[i], b = face[(i + 1) % 3];
    const bool a_in = projected.corners[a].inverse_z > 0, b_in = projected.corners[b].inverse_z > 0;
    if (a_in) out.corner[out.count++] = projected.corners[a];
    if (a_in != b_in) {
      // From the lower index, so that two faces cut a shared edge at the same point.
      const Vector3d& p = projected.in_camera[std::min(a, b)];
      const Vector3d& q = projected.in_camera[std::max(a, b)];
      Vector3d cut = p + (near_m - p.z()) / (q.z() - p.z()) * (q - p);
      cut.z() = near_m;
      out.corner[out.count++] = ToCorner(k, cut);
    }
  }
  return out;
}

}  // namespace

PosedCamera PyramidCamera(const PosedCamera& camera, int level) {
  PosedCamera out = camera;
  PinholeCamera& k = out.intrinsics;
  for (int i = 0; i < level; ++i) {
    k.width &= ~1;
    k.height &= ~1;
    k = k.Resized(k.width / 2, k.height / 2);
  }
  return out;
}

PixelRect ProjectedBounds(const TriangleMesh& mesh, const PosedCamera& camera, int margin_px, int alignment_px,
                          double near_m) {
  const PinholeCamera& k = camera.intrinsics;
  const ProjectedMesh projected = ProjectVertices(mesh, camera, near_m);
  const PixelRect whole{0, 0, k.width, k.height};
  double x_min = 1e30, y_min = 1e30, x_max = -1e30, y_max = -1e30;
  for (const Triangle& face : mesh.faces) {
    const Outline outline = MakeOutline(face, projected, k, near_m);
    double fx_min = 1e30, fy_min = 1e30, fx_max = -1e30, fy_max = -1e30;
    for (int i = 0; i < outline.count; ++i) {
      fx_min = std::min(fx_min, outline.corner[i].x);
      fx_max = std::max(fx_max, outline.corner[i].x);
      fy_min = std::min(fy_min, outline.corner[i].y);
      fy_max = std::max(fy_max, outline.corner[i].y);
    }
    if (fx_max < 0 || fy_max < 0 || fx_min > k.width || fy_min > k.height) continue;
    if (outline.count == 4 || !std::isfinite(fx_min + fx_max + fy_min + fy_max)) return whole;
    x_min = std::min(x_min, fx_min);
    x_max = std::max(x_max, fx_max);
    y_min = std::min(y_min, fy_min);
    y_max = std::max(y_max, fy_max);
  }
  if (x_max < x_min) return {};
  const int align = std::max(alignment_px, 1);
  const auto down = [&](double value, int limit) {
    const int v = static_cast<int>(std::floor(std::clamp(value - margin_px, 0.0, static_cast<double>(limit))));
    return v / align * align;
  };
  const auto up = [&](double value, int limit) {
    const int v = static_cast<int>(std::ceil(std::clamp(value + margin_px, 0.0, static_cast<double>(limit))));
    return std::min(limit, (v + align - 1) / align * align);
  };
  return {down(x_min, k.width), down(y_min, k.height), up(x_max, k.width), up(y_max, k.height)};
}

}  // namespace tessera
