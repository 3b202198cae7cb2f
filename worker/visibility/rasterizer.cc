#include "worker/visibility/rasterizer.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "common/base/parallel.h"

namespace tessera {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kBandRows = 32;
constexpr int64_t kGrain = 4096;

// Vertices as one camera sees them.
struct ProjectedMesh {
  std::vector<Vector3d> in_camera;
  std::vector<Vector2d> pixel;  // meaningless where z < near
};

Vector2d ToPixel(const PinholeCamera& k, const Vector3d& p) {
  return {k.fx * p.x() / p.z() + k.cx, k.fy * p.y() / p.z() + k.cy};
}

ProjectedMesh ProjectVertices(const TriangleMesh& mesh, const PosedCamera& camera, double near_m) {
  ProjectedMesh out;
  out.in_camera.resize(mesh.vertices.size());
  out.pixel.resize(mesh.vertices.size());
  ParallelFor(static_cast<int64_t>(mesh.vertices.size()), kGrain, [&](int64_t begin, int64_t end) {
    for (int64_t v = begin; v < end; ++v) {
      out.in_camera[v] = camera.CameraFromWorld(mesh.vertices[v]);
      out.pixel[v] = out.in_camera[v].z() >= near_m ? ToPixel(camera.intrinsics, out.in_camera[v]) : Vector2d(0, 0);
    }
  });
  return out;
}

// A face's outline in pixels after near clipping: 3 or 4 corners, or none.
struct Outline {
  int count = 0;
  std::array<Vector2d, 4> corner;
};

Outline MakeOutline(const Triangle& face, const ProjectedMesh& projected, const PinholeCamera& k, double near_m) {
  Outline out;
  int behind = 0;
  for (uint32_t v : face) behind += projected.in_camera[v].z() < near_m;
  if (behind == 3) return out;
  if (behind == 0) {
    out.count = 3;
    for (int i = 0; i < 3; ++i) out.corner[i] = projected.pixel[face[i]];
    return out;
  }
  for (int i = 0; i < 3; ++i) {
    const uint32_t a = face[i], b = face[(i + 1) % 3];
    const bool a_in = projected.in_camera[a].z() >= near_m, b_in = projected.in_camera[b].z() >= near_m;
    if (a_in) out.corner[out.count++] = projected.pixel[a];
    if (a_in != b_in) {
      // From the lower index, so that two faces cut a shared edge at the same point.
      const Vector3d& p = projected.in_camera[std::min(a, b)];
      const Vector3d& q = projected.in_camera[std::max(a, b)];
      Vector3d cut = p + (near_m - p.z()) / (q.z() - p.z()) * (q - p);
      cut.z() = near_m;
      out.corner[out.count++] = ToPixel(k, cut);
    }
  }
  return out;
}

// First row or column whose centre is at or after `value`, clamped to [0, limit].
int FirstCentre(double value, int limit) {
  const double first = std::ceil(value - 0.5);
  return first <= 0 ? 0 : first >= limit ? limit : static_cast<int>(first);
}

struct RowSpan {
  int first = 0, last = 0;  // half-open
};

RowSpan RowsOf(const Outline& outline, int width, int height) {
  if (outline.count == 0) return {};
  double y_min = outline.corner[0].y(), y_max = y_min, x_min = outline.corner[0].x(), x_max = x_min;
  for (int i = 1; i < outline.count; ++i) {
    y_min = std::min(y_min, outline.corner[i].y());
    y_max = std::max(y_max, outline.corner[i].y());
    x_min = std::min(x_min, outline.corner[i].x());
    x_max = std::max(x_max, outline.corner[i].x());
  }
  if (!(x_max > 0 && x_min < width && y_max > 0 && y_min < height)) return {};
  return {FirstCentre(y_min, height), FirstCentre(y_max, height)};
}

// Where the edge a-b meets the height y, computed alike whichever way round the edge comes.
double CrossingX(const Vector2d& a, const Vector2d& b, double y) {
  const Vector2d& low = a.y() < b.y() ? a : b;
  const Vector2d& high = a.y() < b.y() ? b : a;
  return low.x() + (y - low.y()) * ((high.x() - low.x()) / (high.y() - low.y()));
}

// 1/z over the image plane: linear, clamped to the face's own range (which steadies faces seen edge-on).
struct InverseDepth {
  double at_x = 0, at_y = 0, constant = 0, low = 0, high = 0;
};

InverseDepth MakeInverseDepth(const Triangle& face, const ProjectedMesh& projected, const PinholeCamera& k,
                              double near_m) {
  const Vector3d &a = projected.in_camera[face[0]], &b = projected.in_camera[face[1]],
                 &c = projected.in_camera[face[2]];
  const Vector3d n = (b - a).cross(c - a);
  const double h = n.dot(a);
  InverseDepth out;
  const double z_min = std::max(near_m, std::min({a.z(), b.z(), c.z()}));
  const double z_max = std::max(near_m, std::max({a.z(), b.z(), c.z()}));
  out.low = 1 / z_max;
  out.high = 1 / z_min;
  if (h == 0 || !std::isfinite(1 / h)) {
    out.constant = out.high;
    return out;
  }
  out.at_x = n.x() / (h * k.fx);
  out.at_y = n.y() / (h * k.fy);
  out.constant = n.z() / h - out.at_x * k.cx - out.at_y * k.cy;
  return out;
}

// Draws one mesh over rows [row_first, row_last) of the maps. `inverse` holds 1/z (0: nothing).
class BandPainter {
 public:
  BandPainter(const TriangleMesh& mesh, const ProjectedMesh& projected, const PinholeCamera& k, double near_m)
      : mesh_(mesh), projected_(projected), k_(k), near_m_(near_m) {}

  void Paint(uint32_t f, int row_first, int row_last, bool with_id, FaceMap* map, float* inverse) const {
    const Outline outline = MakeOutline(mesh_.faces[f], projected_, k_, near_m_);
    RowSpan rows = RowsOf(outline, k_.width, k_.height);
    rows.first = std::max(rows.first, row_first);
    rows.last = std::min(rows.last, row_last);
    if (rows.first >= rows.last) return;
    const InverseDepth plane = MakeInverseDepth(mesh_.faces[f], projected_, k_, near_m_);
    for (int y = rows.first; y < rows.last; ++y) {
      const double yc = y + 0.5;
      double x_in = std::numeric_limits<double>::infinity(), x_out = -x_in;
      for (int i = 0; i < outline.count; ++i) {
        const Vector2d& a = outline.corner[i];
        const Vector2d& b = outline.corner[i + 1 == outline.count ? 0 : i + 1];
        if ((a.y() <= yc) == (b.y() <= yc)) continue;
        const double x = CrossingX(a, b, yc);
        x_in = std::min(x_in, x);
        x_out = std::max(x_out, x);
      }
      if (!(x_in < x_out)) continue;
      const int first = FirstCentre(x_in, k_.width), last = FirstCentre(x_out, k_.width);
      const double row_value = plane.constant + plane.at_y * yc;
      const size_t row = static_cast<size_t>(y) * k_.width;
      for (int x = first; x < last; ++x) {
        const float value = static_cast<float>(std::clamp(row_value + plane.at_x * (x + 0.5), plane.low, plane.high));
        if (value > inverse[row + x]) {
          inverse[row + x] = value;
          map->face[row + x] = with_id ? static_cast<int32_t>(f) : -1;
        }
      }
    }
  }

  // Faces that touch each band, ascending.
  std::vector<std::vector<uint32_t>> Bands() const {
    const int64_t faces = static_cast<int64_t>(mesh_.faces.size());
    std::vector<RowSpan> rows(faces);
    ParallelFor(faces, kGrain, [&](int64_t begin, int64_t end) {
      for (int64_t f = begin; f < end; ++f) {
        rows[f] = RowsOf(MakeOutline(mesh_.faces[f], projected_, k_, near_m_), k_.width, k_.height);
      }
    });
    std::vector<std::vector<uint32_t>> bands((k_.height + kBandRows - 1) / kBandRows);
    for (int64_t f = 0; f < faces; ++f) {
      if (rows[f].first >= rows[f].last) continue;
      const int last_band = (rows[f].last - 1) / kBandRows;
      for (int band = rows[f].first / kBandRows; band <= last_band; ++band) {
        bands[band].push_back(static_cast<uint32_t>(f));
      }
    }
    return bands;
  }

 private:
  const TriangleMesh& mesh_;
  const ProjectedMesh& projected_;
  const PinholeCamera& k_;
  const double near_m_;
};

}  // namespace

FaceMap RasterizeFaces(const TriangleMesh& mesh, const TriangleMesh* occluders, const PosedCamera& camera,
                       double near_m) {
  const PinholeCamera& k = camera.intrinsics;
  FaceMap map;
  map.width = k.width;
  map.height = k.height;
  const size_t pixels = static_cast<size_t>(k.width) * k.height;
  map.face.assign(pixels, -1);
  map.depth.assign(pixels, 0);  // holds 1/z until the end

  const TriangleMesh* layers[] = {&mesh, occluders};
  for (const TriangleMesh* layer : layers) {
    if (layer == nullptr || layer->faces.empty()) continue;
    const ProjectedMesh projected = ProjectVertices(*layer, camera, near_m);
    const BandPainter painter(*layer, projected, k, near_m);
    const std::vector<std::vector<uint32_t>> bands = painter.Bands();
    ParallelFor(static_cast<int64_t>(bands.size()), 1, [&](int64_t begin, int64_t end) {
      for (int64_t band = begin; band < end; ++band) {
        const int first = static_cast<int>(band) * kBandRows, last = std::min(k.height, first + kBandRows);
        for (uint32_t f : bands[band]) painter.Paint(f, first, last, layer == &mesh, &map, map.depth.data());
      }
    });
  }
  ParallelFor(static_cast<int64_t>(pixels), 1 << 16, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) map.depth[i] = map.depth[i] > 0 ? 1 / map.depth[i] : FaceMap::kNothing;
  });
  return map;
}

PosedCamera CroppedCamera(const PosedCamera& camera, const PixelRect& rect) {
  PosedCamera out = camera;
  out.intrinsics.width = rect.width();
  out.intrinsics.height = rect.height();
  out.intrinsics.cx -= rect.x0;
  out.intrinsics.cy -= rect.y0;
  return out;
}

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
      fx_min = std::min(fx_min, outline.corner[i].x());
      fx_max = std::max(fx_max, outline.corner[i].x());
      fy_min = std::min(fy_min, outline.corner[i].y());
      fy_max = std::max(fy_max, outline.corner[i].y());
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
