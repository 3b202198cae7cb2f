#include "common/exporting/obj/cut_by_rects.h"

#include <algorithm>
#include <array>
#include <utility>

#include "common/geometry/position_index.h"

namespace tessera {
namespace {

using CutPolygon = std::vector<uint32_t>;  // vertices, counter-clockwise

size_t CutLinesUpTo(const std::vector<double>& lines, double position) {
  return static_cast<size_t>(std::upper_bound(lines.begin(), lines.end(), position) - lines.begin());
}
size_t CutLinesBelow(const std::vector<double>& lines, double position) {
  return static_cast<size_t>(std::lower_bound(lines.begin(), lines.end(), position) - lines.begin());
}

class RectCutter {
 public:
  RectCutter(const TileRects& rects, std::vector<Eigen::Vector3d> vertices)
      : rects_(rects), lines_({&rects.xs(), &rects.ys()}) {
    cut_.vertices = std::move(vertices);
    first_cut_ = cut_.vertices.size();
    for (Eigen::Vector3d& vertex : cut_.vertices) {
      for (int axis = 0; axis < 2; ++axis) SnapToLine(axis, &vertex);
    }
  }

  void Add(const Triangle& face, uint32_t source) {
    source_ = source;
    const CellRange columns = CellsOf(0, face), rows = CellsOf(1, face);
    if (columns.first >= columns.last && rows.first >= rows.last) {
      return AddFace(face, rects_.OwnerOf(columns.first, rows.first));
    }
    CutPolygon polygon(face.begin(), face.end());
    CutAlong(0, &polygon, [&](size_t column, CutPolygon* strip) {
      CutAlong(1, strip, [&](size_t row, const CutPolygon* piece) { AddPiece(*piece, rects_.OwnerOf(column, row)); });
    });
  }

  CutMesh Take() { return std::move(cut_); }

 private:
  void SnapToLine(int axis, Eigen::Vector3d* point) const {
    const std::vector<double>& lines = *lines_[static_cast<size_t>(axis)];
    double& position = (*point)[axis];
    const size_t above = CutLinesBelow(lines, position);
    if (above < lines.size() && lines[above] - position < rects_.snap()) position = lines[above];
    if (above > 0 && position - lines[above - 1] < rects_.snap()) position = lines[above - 1];
  }

  struct CellRange {
    size_t first, last;  // last <= first: no line crosses
  };
  template <class Vertices>
  CellRange CellsOf(int axis, const Vertices& polygon) const {
    double low = cut_.vertices[polygon.front()][axis], high = low;
    for (const uint32_t v : polygon) {
      low = std::min(low, cut_.vertices[v][axis]);
      high = std::max(high, cut_.vertices[v][axis]);
    }
    const std::vector<double>& lines = *lines_[static_cast<size_t>(axis)];
    return {CutLinesUpTo(lines, low), CutLinesBelow(lines, high)};
  }

  // Calls `use` with the parts of `polygon` between the lines of an axis, and the number of their column or row.
  template <class Use>
  void CutAlong(int axis, CutPolygon* polygon, const Use& use) {
    const CellRange cells = CellsOf(axis, *polygon);
    for (size_t cell = cells.first; cell < cells.last; ++cell) {
      CutPolygon below = Split(axis, (*lines_[static_cast<size_t>(axis)])[cell], polygon);
      use(cell, &below);
    }
    use(std::max(cells.first, cells.last), polygon);
  }

  // Leaves the part of the polygon above the line, and returns the part below it.
  CutPolygon Split(int axis, double line, CutPolygon* polygon) {
    CutPolygon below, above;
    for (size_t k = 0; k < polygon->size(); ++k) {
      const uint32_t a = (*polygon)[k], b = (*polygon)[(k + 1) % polygon->size()];
      const double at_a = cut_.vertices[a][axis], at_b = cut_.vertices[b][axis];
      if (at_a <= line) below.push_back(a);
      if (at_a >= line) above.push_back(a);
      if ((at_a < line && at_b > line) || (at_a > line && at_b < line)) {
        const uint32_t cut = CutPoint(axis, line, a, b);
        below.push_back(cut);
        above.push_back(cut);
      }
    }
    *polygon = std::move(above);
    return below;
  }

  uint32_t CutPoint(int axis, double line, uint32_t a, uint32_t b) {
    Eigen::Vector3d from = cut_.vertices[a], to = cut_.vertices[b];
    // The same order for both faces of the edge.
    if (std::lexicographical_compare(to.begin(), to.end(), from.begin(), from.end())) std::swap(from, to);
    Eigen::Vector3d point = from + (line - from[axis]) / (to[axis] - from[axis]) * (to - from);
    point[axis] = line;
    SnapToLine(1 - axis, &point);
    const size_t index = first_cut_ + cuts_.NumberOf(point);
    if (index == cut_.vertices.size()) cut_.vertices.push_back(point);
    return static_cast<uint32_t>(index);
  }

  double Area(const Triangle& t) const {
    const std::vector<Eigen::Vector3d>& v = cut_.vertices;
    return (v[t[1]] - v[t[0]]).cross(v[t[2]] - v[t[0]]).norm() / 2;
  }

  // Splits a polygon into the fan whose smallest triangle is the largest.
  void AddPiece(const CutPolygon& polygon, int32_t owner) {
    const size_t n = polygon.size();
    const auto triangle = [&](size_t first, size_t k) {
      return Triangle{polygon[first], polygon[(first + k) % n], polygon[(first + k + 1) % n]};
    };
    size_t best = 0;
    double best_area = -1;
    for (size_t first = 0; first < n; ++first) {
      double least = Area(triangle(first, 1));
      for (size_t k = 2; k + 1 < n; ++k) least = std::min(least, Area(triangle(first, k)));
      if (least <= best_area) continue;
      best = first;
      best_area = least;
    }
    for (size_t k = 1; k + 1 < n; ++k) {
      if (Area(triangle(best, k)) > 0) AddFace(triangle(best, k), owner);
    }
  }

  void AddFace(const Triangle& face, int32_t owner) {
    cut_.faces.push_back(face);
    cut_.source_faces.push_back(source_);
    cut_.tiles.push_back(owner);
  }

  const TileRects& rects_;
  const std::array<const std::vector<double>*, 2> lines_;
  CutMesh cut_;
  size_t first_cut_ = 0;  // of the vertices
  PositionIndex cuts_;
  uint32_t source_ = 0;
};

}  // namespace

CutMesh CutByRects(std::vector<Eigen::Vector3d> vertices, std::span<const Triangle> faces, const TileRects& rects) {
  RectCutter cutter(rects, std::move(vertices));
  for (size_t f = 0; f < faces.size(); ++f) cutter.Add(faces[f], static_cast<uint32_t>(f));
  return cutter.Take();
}

}  // namespace tessera
