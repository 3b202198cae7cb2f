#include "common/render/coloring.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "common/base/parallel.h"

namespace tessera {
namespace {

const Color kUnlabelled(1.f, 0.85f, 0.9f);

int LabelOf(const TriangleMesh& mesh, int64_t face) {
  return mesh.labels.empty() || face < 0 ? -1 : mesh.labels[static_cast<size_t>(face)];
}

}  // namespace

SurfaceColor UniformColor(const Color& color) {
  return [color](size_t, const Eigen::Vector3d&) { return color; };
}

SurfaceColor LabelColor(const TriangleMesh& mesh, const Palette& palette) {
  return [&mesh, palette](size_t face, const Eigen::Vector3d&) -> Color {
    const int label = LabelOf(mesh, static_cast<int64_t>(face));
    if (label < 0 || label >= static_cast<int>(palette.size())) return kUnlabelled;
    const auto& rgb = palette[label];
    return Color(rgb[0], rgb[1], rgb[2]) / 255.f;
  };
}

SurfaceColor LabelErrorColor(const TriangleMesh& mesh, const TriangleMesh& truth, const NearestSurface& truth_surface) {
  return [&](size_t face, const Eigen::Vector3d& point) -> Color {
    const int expected = LabelOf(truth, truth_surface.Find(point).face);
    if (expected < 0) return Color(1, 1, 1);
    return expected == LabelOf(mesh, static_cast<int64_t>(face)) ? Color(0.75f, 0.75f, 0.75f) : Color(0.9f, 0.1f, 0.1f);
  };
}

SurfaceColor NormalColor(const TriangleMesh& mesh) {
  return [&mesh](size_t face, const Eigen::Vector3d&) -> Color {
    return (0.5 * (FaceNormal(mesh, face) + Eigen::Vector3d::Ones())).cast<float>();
  };
}

double SignedDistance(const Eigen::Vector3d& point, const TriangleMesh& reference, const NearestSurface& surface) {
  const NearestPoint nearest = surface.Find(point);
  if (nearest.face < 0) return 0;
  const double side = FaceNormal(reference, static_cast<size_t>(nearest.face)).dot(point - nearest.point);
  return std::copysign(nearest.distance_m, side);
}

Color DivergingColor(double value) {
  const float v = static_cast<float>(std::clamp(value, -1.0, 1.0));
  const Color end = v < 0 ? Color(0.13f, 0.30f, 0.75f) : Color(0.80f, 0.10f, 0.15f);
  return Color(0.96f, 0.96f, 0.96f) + std::abs(v) * (end - Color(0.96f, 0.96f, 0.96f));
}

SurfaceColor DisplacementColor(const TriangleMesh& reference, const NearestSurface& surface, double range_m) {
  return [&reference, &surface, range_m](size_t, const Eigen::Vector3d& point) -> Color {
    return DivergingColor(SignedDistance(point, reference, surface) / range_m);
  };
}

double DisplacementRange(const TriangleMesh& mesh, const NearestSurface& reference) {
  std::vector<std::pair<double, double>> distance_and_area(mesh.faces.size());
  ParallelForEach(mesh.faces.size(), 1024, [&](size_t f) {
    const Eigen::Vector3d centre = MeshSpans(mesh).Centroid(f);
    distance_and_area[f] = {reference.Find(centre).distance_m, FaceArea(mesh, f)};
  });
  std::sort(distance_and_area.begin(), distance_and_area.end());
  double total = 0, passed = 0, quantile_m = 0;
  for (const auto& [distance_m, area_m2] : distance_and_area) total += area_m2;
  for (const auto& [distance_m, area_m2] : distance_and_area) {
    quantile_m = distance_m;
    passed += area_m2;
    if (passed >= 0.9 * total) break;
  }
  if (!(quantile_m > 1e-6)) return 1e-6;
  const double power = std::pow(10.0, std::floor(std::log10(quantile_m)));
  for (double step : {1.0, 2.0, 5.0}) {
    if (quantile_m <= step * power) return step * power;
  }
  return 10 * power;
}

}  // namespace tessera
