#include "common/exporting/raster/surface_raster.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

namespace tessera {
namespace {

constexpr uint32_t kNoRasterVertex = std::numeric_limits<uint32_t>::max();

// Adds the faces of `sheet` whose bounding rectangle in the plane meets that of `low` and `high`.
void AddRasterFaces(const Sheet& sheet, const GroundPlane& ground, const Eigen::Array2d& low,
                    const Eigen::Array2d& high, RasterSurface* surface) {
  std::vector<uint32_t> index(sheet.vertices.size(), kNoRasterVertex);
  for (size_t f = 0; f < sheet.faces.size(); ++f) {
    const Triangle& face = sheet.faces[f];
    const Eigen::Array2d a = ground.Coordinates(sheet.vertices[face[0]]);
    const Eigen::Array2d b = ground.Coordinates(sheet.vertices[face[1]]);
    const Eigen::Array2d c = ground.Coordinates(sheet.vertices[face[2]]);
    if ((a.max(b).max(c) < low).any() || (a.min(b).min(c) > high).any()) continue;
    Triangle added;
    for (int k = 0; k < 3; ++k) {
      uint32_t& vertex = index[face[k]];
      if (vertex == kNoRasterVertex) {
        vertex = static_cast<uint32_t>(surface->local.size());
        surface->local.push_back(sheet.vertices[face[k]]);
      }
      added[k] = vertex;
    }
    surface->faces.push_back(added);
    surface->labels.push_back(sheet.labels[f]);
  }
}

double LargestRasterHeight(const Sheet& sheet, const Eigen::Vector3d& up) {
  double largest_m = 0;
  for (const Eigen::Vector3d& p : sheet.vertices) largest_m = std::max(largest_m, std::abs(up.dot(p)));
  return largest_m;
}

// A vertex in units of pixels from the south-west corner of a box.
Eigen::Vector2d InPixels(const Eigen::Vector3d& p, const RasterBox& box, const Eigen::Vector2d& pixel_size) {
  return {p.x() / pixel_size.x() - static_cast<double>(box.x0), p.y() / pixel_size.y() - static_cast<double>(box.y0)};
}

// Twice the area of (p, q, at), with its sign. Exactly antisymmetric in p and q, so that both faces of an edge decide
// alike.
double RasterSideOf(const Eigen::Vector2d& p, const Eigen::Vector2d& q, const Eigen::Vector2d& at) {
  const bool swapped = q.x() < p.x() || (q.x() == p.x() && q.y() < p.y());
  const Eigen::Vector2d &first = swapped ? q : p, &second = swapped ? p : q;
  const Eigen::Vector2d edge = second - first, to = at - first;
  const double side = edge.x() * to.y() - edge.y() * to.x();
  return swapped ? -side : side;
}

// Barycentric weights, not normalised, all of one sign if the point is inside.
std::array<double, 3> WeightsAt(const std::array<Eigen::Vector2d, 3>& corners, const Eigen::Vector2d& at) {
  return {RasterSideOf(corners[1], corners[2], at), RasterSideOf(corners[2], corners[0], at),
          RasterSideOf(corners[0], corners[1], at)};
}

// The columns of [0, width) whose centres may be inside the face in the row with centre y.
std::pair<int, int> ColumnsOf(const std::array<Eigen::Vector2d, 3>& corners, double y, int width) {
  constexpr double kSlack = 1e-6;  // pixels, above rounding errors; WeightsAt decides
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector2d &p = corners[k], &q = corners[(k + 1) % 3];
    if ((p.y() < y && q.y() < y) || (p.y() > y && q.y() > y)) continue;
    const double t = p.y() == q.y() ? 0 : (y - p.y()) / (q.y() - p.y());
    const double x = p.x() + t * (q.x() - p.x());
    low = std::min({low, x, p.y() == q.y() ? q.x() : x});
    high = std::max({high, x, p.y() == q.y() ? q.x() : x});
  }
  const double first = std::max(0.0, std::ceil(low - 0.5 - kSlack));
  const double last = std::min(width - 1.0, std::floor(high - 0.5 + kSlack));
  if (!(first <= last)) return {0, -1};
  return {static_cast<int>(first), static_cast<int>(last)};
}

}  // namespace

StatusOr<RasterSurface> SurfaceOfSheet(const SheetInput& input, const RasterMap& map) {
  const ExportScene& scene = input.scene;
  const double side_m = kSheetCells * scene.ground.cell_m;
  // The verticals of the system differ from `up` by less than this far from the frame's origin.
  constexpr double kLargestTilt = 0.01;
  double height_m = LargestRasterHeight(input.sheet, scene.up);
  for (const Sheet& sheet : input.neighbours) height_m = std::max(height_m, LargestRasterHeight(sheet, scene.up));
  const double margin_m = scene.ground.cell_m + kLargestTilt * height_m;
  const Eigen::Array2d low = side_m * Eigen::Array2d(input.id.x, input.id.y) - margin_m;
  const Eigen::Array2d high = low + side_m + 2 * margin_m;
  RasterSurface surface;
  AddRasterFaces(input.sheet, scene.ground, low, high, &surface);
  for (const Sheet& sheet : input.neighbours) AddRasterFaces(sheet, scene.ground, low, high, &surface);
  surface.mapped = surface.local;
  TESSERA_RETURN_IF_ERROR(map.FromLocal(surface.mapped));
  return surface;
}

TopFaces FindTopFaces(std::span<const Eigen::Vector3d> vertices, std::span<const Triangle> faces, const RasterBox& box,
                      const Eigen::Vector2d& pixel_size) {
  TopFaces top;
  top.face.assign(box.pixels(), -1);
  top.height.assign(box.pixels(), -std::numeric_limits<double>::infinity());
  for (size_t f = 0; f < faces.size(); ++f) {
    std::array<Eigen::Vector2d, 3> corners;
    Eigen::Vector3d heights;
    for (int k = 0; k < 3; ++k) {
      corners[k] = InPixels(vertices[faces[f][k]], box, pixel_size);
      heights[k] = vertices[faces[f][k]].z();
    }
    const auto [south, north] = std::minmax({corners[0].y(), corners[1].y(), corners[2].y()});
    const double first = std::max(0.0, std::ceil(south - 0.5)),
                 last = std::min(box.height - 1.0, std::floor(north - 0.5));
    for (double j = first; j <= last; ++j) {
      const auto [column0, column1] = ColumnsOf(corners, j + 0.5, box.width);
      const size_t row = static_cast<size_t>(box.height - 1 - static_cast<int>(j)) * box.width;
      for (int column = column0; column <= column1; ++column) {
        const auto [a, b, c] = WeightsAt(corners, {column + 0.5, j + 0.5});
        const bool inside = (a >= 0 && b >= 0 && c >= 0) || (a <= 0 && b <= 0 && c <= 0);
        const double sum = a + b + c;
        if (!inside || sum == 0) continue;  // a sum of zero: no area in plan
        const double height = (a * heights[0] + b * heights[1] + c * heights[2]) / sum;
        const size_t pixel = row + column;
        if (!(height > top.height[pixel])) continue;
        top.height[pixel] = height;
        top.face[pixel] = static_cast<int32_t>(f);
      }
    }
  }
  return top;
}

Eigen::Vector3d PointOfPixel(const RasterSurface& surface, int32_t face, int column, int row, const RasterBox& box,
                             const Eigen::Vector2d& pixel_size) {
  const Triangle& corner = surface.faces[face];
  std::array<Eigen::Vector2d, 3> corners;
  for (int k = 0; k < 3; ++k) corners[k] = InPixels(surface.mapped[corner[k]], box, pixel_size);
  const auto [a, b, c] = WeightsAt(corners, {column + 0.5, box.height - 1 - row + 0.5});
  return (a * surface.local[corner[0]] + b * surface.local[corner[1]] + c * surface.local[corner[2]]) / (a + b + c);
}

StatusOr<SheetRaster> RasterizeSheet(const SheetInput& input, const RasterMap& map, const TaskControl& control) {
  SheetRaster raster;
  TESSERA_ASSIGN_OR_RETURN(raster.box, BoxOfSheet(map, input.scene, input.id));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<uint8_t> owned, PixelsOfSheet(map, input.scene, input.id, raster.box));
  TESSERA_RETURN_IF_ERROR(control.Check());
  TESSERA_ASSIGN_OR_RETURN(raster.surface, SurfaceOfSheet(input, map));
  TESSERA_RETURN_IF_ERROR(control.Check());
  raster.top = FindTopFaces(raster.surface.mapped, raster.surface.faces, raster.box, map.pixel_size());
  for (size_t p = 0; p < owned.size(); ++p) {
    if (!owned[p]) raster.top.face[p] = -1;
  }
  return raster;
}

}  // namespace tessera
