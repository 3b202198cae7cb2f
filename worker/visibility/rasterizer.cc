#include "worker/visibility/rasterizer.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/base/parallel.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

constexpr int kBandRows = 32;
constexpr int64_t kGrain = 4096;
constexpr int64_t kFaceChunk = 16384;

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

// First row or column whose centre is at or after `value`, clamped to [0, limit].
int FirstCentre(double value, int limit) {
  const double shifted = value - 0.5;
  if (!(shifted > 0)) return 0;
  if (shifted >= limit) return limit;
  const int whole = static_cast<int>(shifted);
  return whole + (static_cast<double>(whole) < shifted ? 1 : 0);
}

struct RowSpan {
  int first = 0, last = 0;  // half-open
};

// Bounding box of some corners.
struct Bounds {
  double x_min, x_max, y_min, y_max;
  explicit Bounds(const Corner& c) : x_min(c.x), x_max(c.x), y_min(c.y), y_max(c.y) {}
  void Add(const Corner& c) {
    x_min = std::min(x_min, c.x);
    x_max = std::max(x_max, c.x);
    y_min = std::min(y_min, c.y);
    y_max = std::max(y_max, c.y);
  }
};

// Rows with a pixel centre inside the box; none if it holds no centre at all.
RowSpan RowsOf(const Bounds& box, int width, int height) {
  if (!(box.x_max > 0 && box.x_min < width && box.y_max > 0 && box.y_min < height)) return {};
  const int first = FirstCentre(box.y_min, height), last = FirstCentre(box.y_max, height);
  if (first >= last || FirstCentre(box.x_min, width) >= FirstCentre(box.x_max, width)) return {};
  return {first, last};
}

bool InFront(const Triangle& face, const ProjectedMesh& projected) {
  return projected.corners[face[0]].inverse_z > 0 && projected.corners[face[1]].inverse_z > 0 &&
         projected.corners[face[2]].inverse_z > 0;
}

RowSpan RowsOfFace(const Triangle& face, const ProjectedMesh& projected, const PinholeCamera& k, double near_m) {
  if (InFront(face, projected)) {
    Bounds box(projected.corners[face[0]]);
    box.Add(projected.corners[face[1]]);
    box.Add(projected.corners[face[2]]);
    return RowsOf(box, k.width, k.height);
  }
  const Outline outline = MakeOutline(face, projected, k, near_m);
  if (outline.count == 0) return {};
  Bounds box(outline.corner[0]);
  for (int i = 1; i < outline.count; ++i) box.Add(outline.corner[i]);
  return RowsOf(box, k.width, k.height);
}

// x over y along an edge whose ends are ordered by y, then x, so that it is the same whichever way round the edge
// comes.
struct EdgeLine {
  double y_low, y_high, x_low, slope;
};

EdgeLine MakeEdgeLine(const Corner& a, const Corner& b) {
  const bool a_low = a.y < b.y || (a.y == b.y && a.x < b.x);
  const Corner& low = a_low ? a : b;
  const Corner& high = a_low ? b : a;
  return {low.y, high.y, low.x, (high.x - low.x) / (high.y - low.y)};
}

// Draws triangles into rows [row_first, row_last) of the maps; `inverse` holds 1/z (0: nothing).
struct BandPainter {
  int width = 0, row_first = 0, row_last = 0;
  int32_t* face = nullptr;
  float* inverse = nullptr;

  void Paint(const Corner& a, const Corner& b, const Corner& c, int32_t id) const {
    const int first_row = std::max(row_first, FirstCentre(std::min({a.y, b.y, c.y}), row_last));
    const int last_row = FirstCentre(std::max({a.y, b.y, c.y}), row_last);
    if (first_row >= last_row) return;
    const EdgeLine edges[3] = {MakeEdgeLine(a, b), MakeEdgeLine(b, c), MakeEdgeLine(c, a)};
    // 1/z as a plane over the image, clamped to the face's own range, which steadies faces seen edge-on.
    const double bx = b.x - a.x, by = b.y - a.y, cx = c.x - a.x, cy = c.y - a.y;
    const double bz = b.inverse_z - a.inverse_z, cz = c.inverse_z - a.inverse_z;
    const double area = bx * cy - by * cx;
    const double inverse_area = area != 0 ? 1 / area : 0;
    const double per_x = (bz * cy - cz * by) * inverse_area, per_y = (cz * bx - bz * cx) * inverse_area;
    const float low = static_cast<float>(std::min({a.inverse_z, b.inverse_z, c.inverse_z}));
    const float high = static_cast<float>(std::max({a.inverse_z, b.inverse_z, c.inverse_z}));
    for (int y = first_row; y < last_row; ++y) {
      const double yc = y + 0.5;
      double x_in = std::numeric_limits<double>::infinity(), x_out = -x_in;
      for (const EdgeLine& edge : edges) {
        if (!(edge.y_low <= yc && yc < edge.y_high)) continue;
        const double x = edge.x_low + (yc - edge.y_low) * edge.slope;
        x_in = std::min(x_in, x);
        x_out = std::max(x_out, x);
      }
      if (!(x_in < x_out)) continue;
      const int first = FirstCentre(x_in, width), last = FirstCentre(x_out, width);
      const double at_row = a.inverse_z + per_y * (yc - a.y) + per_x * (0.5 - a.x);
      const size_t row = static_cast<size_t>(y) * width;
      for (int x = first; x < last; ++x) {
        const float value = std::clamp(static_cast<float>(at_row + per_x * x), low, high);
        if (value > inverse[row + x]) {
          inverse[row + x] = value;
          face[row + x] = id;
        }
      }
    }
  }
};

// Faces that may cover pixel centres of each band of rows, ascending.
std::vector<std::vector<uint32_t>> MakeBands(const TriangleMesh& mesh, const ProjectedMesh& projected,
                                             const PinholeCamera& k, double near_m) {
  const int64_t faces = static_cast<int64_t>(mesh.faces.size());
  const size_t bands = (k.height + kBandRows - 1) / kBandRows;
  const int64_t chunks = (faces + kFaceChunk - 1) / kFaceChunk;
  std::vector<std::vector<std::vector<uint32_t>>> of_chunk(chunks, std::vector<std::vector<uint32_t>>(bands));
  ParallelFor(faces, kFaceChunk, [&](int64_t begin, int64_t end) {
    std::vector<std::vector<uint32_t>>& mine = of_chunk[begin / kFaceChunk];
    for (int64_t f = begin; f < end; ++f) {
      const RowSpan rows = RowsOfFace(mesh.faces[f], projected, k, near_m);
      if (rows.first >= rows.last) continue;
      const int last_band = (rows.last - 1) / kBandRows;
      for (int band = rows.first / kBandRows; band <= last_band; ++band) {
        mine[band].push_back(static_cast<uint32_t>(f));
      }
    }
  });
  std::vector<std::vector<uint32_t>> out(bands);
  ParallelFor(static_cast<int64_t>(bands), 1, [&](int64_t begin, int64_t end) {
    for (int64_t band = begin; band < end; ++band) {
      for (const auto& chunk : of_chunk) out[band].insert(out[band].end(), chunk[band].begin(), chunk[band].end());
    }
  });
  return out;
}

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
    const std::vector<std::vector<uint32_t>> bands = MakeBands(*layer, projected, k, near_m);
    ParallelFor(static_cast<int64_t>(bands.size()), 1, [&](int64_t begin, int64_t end) {
      for (int64_t band = begin; band < end; ++band) {
        const int first = static_cast<int>(band) * kBandRows;
        const BandPainter painter{k.width, first, std::min(k.height, first + kBandRows), map.face.data(),
                                  map.depth.data()};
        for (uint32_t f : bands[band]) {
          const Triangle& face = layer->faces[f];
          const int32_t id = layer == &mesh ? static_cast<int32_t>(f) : -1;
          if (InFront(face, projected)) {
            const std::vector<Corner>& corners = projected.corners;
            painter.Paint(corners[face[0]], corners[face[1]], corners[face[2]], id);
            continue;
          }
          const Outline outline = MakeOutline(face, projected, k, near_m);
          painter.Paint(outline.corner[0], outline.corner[1], outline.corner[2], id);
          if (outline.count == 4) painter.Paint(outline.corner[0], outline.corner[2], outline.corner[3], id);
        }
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
