#include "common/exporting/raster/raster_grid.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

constexpr int kMaxRasterSide = 12000;  // pixels; a sheet has at most 1,449 GSD, turned by 45 degrees at GSD / 4

int64_t RasterFloor(int64_t value, int64_t step) {
  const int64_t quotient = value / step;
  return (value % step < 0 ? quotient - 1 : quotient) * step;
}

// Points on the border of a sheet's square, plane coordinates.
std::vector<Eigen::Vector2d> SheetBorder(const ExportScene& scene, const SheetId& id) {
  constexpr int kSteps = 16;
  const double side_m = kSheetCells * scene.ground.cell_m;
  std::vector<Eigen::Vector2d> border;
  for (int k = 0; k <= kSteps; ++k) {
    const double t = static_cast<double>(k) / kSteps;
    for (const Eigen::Vector2d& p :
         {Eigen::Vector2d(t, 0), Eigen::Vector2d(t, 1), Eigen::Vector2d(0, t), Eigen::Vector2d(1, t)}) {
      border.push_back(side_m * (Eigen::Vector2d(id.x, id.y) + p));
    }
  }
  return border;
}

}  // namespace

StatusOr<RasterBox> BoxOfSheet(const RasterMap& map, const ExportScene& scene, const SheetId& id) {
  const std::vector<Eigen::Vector2d> border = SheetBorder(scene, id);
  const GroundPlane& ground = scene.ground;
  // Find the points at the reference height whose images in the plane are the border.
  std::vector<Eigen::Vector2d> plane = border;
  std::vector<Eigen::Vector3d> points(border.size());
  constexpr int kRounds = 3;
  for (int round = 0; round < kRounds; ++round) {
    for (size_t k = 0; k < border.size(); ++k) points[k] = ground.axis_x * plane[k].x() + ground.axis_y * plane[k].y();
    TESSERA_RETURN_IF_ERROR(map.FromLocal(points));
    for (Eigen::Vector3d& p : points) p.z() = map.reference_height();
    std::vector<Eigen::Vector3d> back = points;
    TESSERA_RETURN_IF_ERROR(map.ToLocal(back));
    for (size_t k = 0; k < border.size(); ++k) plane[k] += border[k] - ground.Coordinates(back[k]);
  }
  Eigen::Array2d low = points[0].head<2>(), high = low;
  for (const Eigen::Vector3d& p : points) {
    low = low.min(p.head<2>().array());
    high = high.max(p.head<2>().array());
  }
  const Eigen::Array2d size = map.pixel_size().array();
  if (!((high - low) / size < kMaxRasterSide).all()) {
    return absl::InvalidArgumentError(absl::StrCat("crs: found ", map.system().name, ", which cuts the sheet ",
                                                   SheetName(id), " at its border, expected a system for this place"));
  }
  constexpr int64_t kMargin = 2;  // pixels, for the bend of the border between points
  const auto first = [&](int k) {
    return RasterFloor(static_cast<int64_t>(std::floor(low[k] / size[k])) - kMargin, kRasterAlignment);
  };
  const auto end = [&](int k) {
    return -RasterFloor(-(static_cast<int64_t>(std::ceil(high[k] / size[k])) + kMargin), kRasterAlignment);
  };
  return RasterBox{first(0), first(1), static_cast<int>(end(0) - first(0)), static_cast<int>(end(1) - first(1))};
}

StatusOr<std::vector<uint8_t>> PixelsOfSheet(const RasterMap& map, const ExportScene& scene, const SheetId& id,
                                             const RasterBox& box) {
  // Plane coordinates are interpolated between nodes, whose places depend on the grid alone.
  constexpr int64_t kStep = 64;
  const int64_t node_x0 = RasterFloor(box.x0, kStep), node_y0 = RasterFloor(box.y0, kStep);
  const auto columns = static_cast<size_t>((box.x0 + box.width - node_x0) / kStep + 2);
  const auto rows = static_cast<size_t>((box.y0 + box.height - node_y0) / kStep + 2);
  const Eigen::Vector2d& size = map.pixel_size();
  std::vector<Eigen::Vector3d> nodes(columns * rows);
  for (size_t n = 0; n < nodes.size(); ++n) {
    const int64_t i = node_x0 + kStep * static_cast<int64_t>(n % columns);
    const int64_t j = node_y0 + kStep * static_cast<int64_t>(n / columns);
    nodes[n] = {(static_cast<double>(i) + 0.5) * size.x(), (static_cast<double>(j) + 0.5) * size.y(),
                map.reference_height()};
  }
  TESSERA_RETURN_IF_ERROR(map.ToLocal(nodes));
  std::vector<Eigen::Vector2d> plane(nodes.size());
  for (size_t n = 0; n < nodes.size(); ++n) plane[n] = scene.ground.Coordinates(nodes[n]);

  const double side_m = kSheetCells * scene.ground.cell_m;
  std::vector<uint8_t> owned(box.pixels());
  for (int row = 0; row < box.height; ++row) {
    const int64_t y = box.y0 + box.height - 1 - row - node_y0;
    const double v = static_cast<double>(y % kStep) / kStep;
    uint8_t* out = owned.data() + static_cast<size_t>(row) * box.width;
    for (int column = 0; column < box.width; ++column) {
      const int64_t x = box.x0 + column - node_x0;
      const double u = static_cast<double>(x % kStep) / kStep;
      const Eigen::Vector2d* at = &plane[static_cast<size_t>(y / kStep) * columns + static_cast<size_t>(x / kStep)];
      const Eigen::Vector2d south = (1 - u) * at[0] + u * at[1], north = (1 - u) * at[columns] + u * at[columns + 1];
      const Eigen::Vector2d p = ((1 - v) * south + v * north) / side_m;
      out[column] = std::floor(p.x()) == id.x && std::floor(p.y()) == id.y;
    }
  }
  return owned;
}

}  // namespace tessera
