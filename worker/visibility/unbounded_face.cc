#include "worker/visibility/unbounded_face.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tessera {
namespace {

using Eigen::Vector3d;

// A corner in grid units of the whole image.
struct Corner {
  double x = 0, y = 0;
  double inverse_z = 0;
  bool on_grid = false;  // x and y are integers
};

Corner Project(const PinholeCamera& k, const Vector3d& in_camera) {
  const double inverse_z = 1 / in_camera.z();
  return {(k.fx * in_camera.x() * inverse_z + k.cx) * kGridPerPixel,
          (k.fy * in_camera.y() * inverse_z + k.cy) * kGridPerPixel, inverse_z, false};
}

// Outline of the face in front of the near plane: 0, 3 or 4 corners. Returns their number.
int MakeOutline(const Triangle& face, const TriangleMesh& mesh, const GridVertex* vertices, const PosedCamera& camera,
                double near_m, const DrawTarget& target, Corner* corners) {
  const double x_first = static_cast<double>(target.x0 * kGridPerPixel);
  const double y_first = static_cast<double>(target.y0 * kGridPerPixel);
  Vector3d in_camera[3];
  for (int i = 0; i < 3; ++i) in_camera[i] = camera.CameraFromWorld(mesh.vertices[face[i]]);
  int count = 0;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    const GridVertex& vertex = vertices[face[i]];
    if (vertex.off_grid == 0) {
      corners[count++] = {vertex.x + x_first, vertex.y + y_first, vertex.inverse_z, true};
    } else if (in_camera[i].z() >= near_m) {
      corners[count++] = Project(camera.intrinsics, in_camera[i]);
    }
    const auto in_front = [&](int c) { return vertices[face[c]].off_grid == 0 || in_camera[c].z() >= near_m; };
    if (in_front(i) == in_front(j)) continue;
    // Start at the lower index, so that both faces of an edge clip it at the same point.
    const bool forward = face[i] < face[j];
    const Vector3d& p = in_camera[forward ? i : j];
    const Vector3d& q = in_camera[forward ? j : i];
    Vector3d cut = p + (near_m - p.z()) / (q.z() - p.z()) * (q - p);
    cut.z() = near_m;
    corners[count++] = Project(camera.intrinsics, cut);
  }
  return count;
}

double TwiceArea(const Corner& a, const Corner& b, const Corner& c) {
  const double bx = b.x - a.x, by = b.y - a.y, cx = c.x - a.x, cy = c.y - a.y;
  if (!a.on_grid || !b.on_grid || !c.on_grid) return bx * cy - by * cx;
  const auto wide = [](double value) { return static_cast<__int128>(value); };
  return static_cast<double>(wide(bx) * wide(cy) - wide(by) * wide(cx));
}

// Twice the signed area that an edge spans with a pixel's centre. Reversing the edge changes only the sign, so that
// its two faces never both own a pixel.
class Edge {
 public:
  Edge(const Corner& from, const Corner& to) : a_(from), b_(to), exact_(from.on_grid && to.on_grid) {
    if (std::pair(b_.y, b_.x) < std::pair(a_.y, a_.x)) {
      std::swap(a_, b_);
      sign_ = -1;
    }
  }
  double Area(int column, int row) const {
    const int64_t x = (int64_t{column} << kGridBits) + kGridHalf, y = (int64_t{row} << kGridBits) + kGridHalf;
    if (exact_) {
      const auto wide = [](double value) { return static_cast<__int128>(value); };
      return sign_ * static_cast<double>((wide(a_.x) - x) * (wide(b_.y) - y) - (wide(a_.y) - y) * (wide(b_.x) - x));
    }
    const double px = static_cast<double>(x), py = static_cast<double>(y);
    return sign_ * ((b_.x - a_.x) * (py - a_.y) - (b_.y - a_.y) * (px - a_.x));
  }
  // Change of the area per column and per row.
  double per_column() const { return sign_ * (a_.y - b_.y); }
  double per_row() const { return sign_ * (b_.x - a_.x); }

 private:
  Corner a_, b_;
  bool exact_;
  double sign_ = 1;
};

// First column or row whose centre is not before `value` (grid units), clamped to [first, limit].
int FirstCentre(double value, int first, int limit) {
  const double pixel = std::ceil(value / kGridPerPixel - 0.5);
  return pixel > first ? static_cast<int>(std::min(pixel, static_cast<double>(limit))) : first;
}

// Restricts the columns of a row to those inside an edge, by bisection: the area is monotone in the column, even
// after rounding.
void ClipToEdge(const Edge& edge, double orientation, int row, int* first, int* last) {
  const double growth = orientation * edge.per_column();
  const bool owns = growth > 0 || (growth == 0 && orientation * edge.per_row() > 0);
  const auto inside = [&](int column) {
    const double area = orientation * edge.Area(column, row);
    return area > 0 || (area == 0 && owns);
  };
  if (growth == 0) {
    if (*first < *last && !inside(*first)) *last = *first;
    return;
  }
  int low = *first, high = *last;
  while (low < high) {
    const int middle = low + (high - low) / 2;
    if (inside(middle) == (growth > 0)) {
      high = middle;
    } else {
      low = middle + 1;
    }
  }
  (growth > 0 ? *first : *last) = low;
}

void DrawTriangle(const Corner& a, const Corner& b, const Corner& c, int32_t id, const DrawTarget& target) {
  const Edge edges[3] = {{b, c}, {c, a}, {a, b}};
  const double total = TwiceArea(a, b, c);
  if (!(total != 0)) return;
  const double orientation = total > 0 ? 1 : -1;
  const DepthPlane plane(a.inverse_z, b.inverse_z, c.inverse_z, total);
  const int x_limit = target.x0 + target.width, y_first = target.y0 + target.row_first;
  const int y_limit = target.y0 + target.row_last;
  const int x_begin = FirstCentre(std::min({a.x, b.x, c.x}), target.x0, x_limit);
  const int x_end = FirstCentre(std::max({a.x, b.x, c.x}) + 1, target.x0, x_limit);
  const int y_begin = FirstCentre(std::min({a.y, b.y, c.y}), y_first, y_limit);
  const int y_end = FirstCentre(std::max({a.y, b.y, c.y}) + 1, y_first, y_limit);
  for (int y = y_begin; y < y_end; ++y) {
    int first = x_begin, last = x_end;
    for (const Edge& edge : edges) ClipToEdge(edge, orientation, y, &first, &last);
    for (int x = first; x < last; ++x) {
      target.Draw(x - target.x0, y - target.y0, plane.At(edges[1].Area(x, y), edges[2].Area(x, y)), id);
    }
  }
}

}  // namespace

void DrawUnboundedFace(const TriangleMesh& mesh, uint32_t f, const GridVertex* vertices, const PosedCamera& camera,
                       double near_m, const DrawTarget& target) {
  const int32_t id = target.selection.NameOf(f);
  Corner corners[6];
  const int count = MakeOutline(mesh.faces[f], mesh, vertices, camera, near_m, target, corners);
  if (count >= 3) DrawTriangle(corners[0], corners[1], corners[2], id, target);
  if (count == 4) DrawTriangle(corners[0], corners[2], corners[3], id, target);
}

}  // namespace tessera
