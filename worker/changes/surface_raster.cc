#include "worker/changes/surface_raster.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "common/base/parallel.h"

namespace tessera {

TopSurface::TopSurface(const MeshSpans& mesh, const GroundPlane& ground)
    : mesh_(mesh),
      axis_x_(ground.axis_x),
      axis_y_(ground.axis_y),
      up_(ground.axis_x.cross(ground.axis_y)),
      caster_(mesh) {
  for (const Eigen::Vector3d& p : mesh.vertices) top_m_ = std::max(top_m_, up_.dot(p));
  top_m_ += 1;
}

TopSurface::Point TopSurface::At(double x_m, double y_m) const {
  const RayHit hit = caster_.Cast(axis_x_ * x_m + axis_y_ * y_m + up_ * top_m_, -up_);
  if (!hit.hit()) return {std::numeric_limits<float>::quiet_NaN(), kNoLabel};
  const int32_t label = mesh_.labels.empty() ? -1 : mesh_.labels[hit.face];
  return {static_cast<float>(top_m_ - hit.distance), label < 0 ? kNoLabel : static_cast<uint8_t>(label)};
}

SurfaceRaster CellsOfSamples(std::span<const TopSurface::Point> samples, const CellRect& cells, double cell_m,
                             int samples_per_cell) {
  SurfaceRaster raster(cells, cell_m);
  const size_t row = static_cast<size_t>(raster.width()) * samples_per_cell;
  std::vector<TopSurface::Point> own;
  for (int y = 0; y < raster.height(); ++y) {
    for (int x = 0; x < raster.width(); ++x) {
      own.clear();
      for (int j = 0; j < samples_per_cell; ++j) {
        for (int i = 0; i < samples_per_cell; ++i) {
          const TopSurface::Point& p = samples[(y * samples_per_cell + j) * row + x * samples_per_cell + i];
          if (!std::isnan(p.height_m)) own.push_back(p);
        }
      }
      if (2 * own.size() <= static_cast<size_t>(samples_per_cell) * samples_per_cell) continue;
      const auto middle = own.begin() + own.size() / 2;
      std::nth_element(own.begin(), middle, own.end(),
                       [](const TopSurface::Point& a, const TopSurface::Point& b) { return a.height_m < b.height_m; });
      const float height_m = middle->height_m;
      std::array<int, 256> votes{};
      for (const TopSurface::Point& p : own) {
        if (std::abs(p.height_m - height_m) <= 0.5 * cell_m) ++votes[p.label];
      }
      const size_t i = static_cast<size_t>(y) * raster.width() + x;
      raster.height_m[i] = height_m;
      raster.label[i] = static_cast<uint8_t>(std::max_element(votes.begin(), votes.end()) - votes.begin());
    }
  }
  return raster;
}

SurfaceRaster DrawSurface(const TopSurface& surface, const GroundPlane& ground, const CellRect& cells,
                          int samples_per_cell) {
  SurfaceRaster raster(cells, ground.cell_m);
  const int width = raster.width() * samples_per_cell;
  const double spacing_m = ground.cell_m / samples_per_cell;
  ParallelFor(raster.height(), 4, [&](int64_t begin, int64_t end) {
    std::vector<TopSurface::Point> samples;
    for (int64_t j = begin * samples_per_cell; j < end * samples_per_cell; ++j) {
      for (int i = 0; i < width; ++i) {
        samples.push_back(surface.At(cells.x0 * ground.cell_m + (i + 0.5) * spacing_m,
                                     cells.y0 * ground.cell_m + (static_cast<double>(j) + 0.5) * spacing_m));
      }
    }
    const CellRect rows{cells.x0, cells.y0 + static_cast<int>(begin), cells.x1, cells.y0 + static_cast<int>(end)};
    const SurfaceRaster part = CellsOfSamples(samples, rows, ground.cell_m, samples_per_cell);
    std::copy(part.height_m.begin(), part.height_m.end(), raster.height_m.begin() + begin * raster.width());
    std::copy(part.label.begin(), part.label.end(), raster.label.begin() + begin * raster.width());
  });
  return raster;
}

}  // namespace tessera
