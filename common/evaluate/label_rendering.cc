#include "common/evaluate/label_rendering.h"

#include <Eigen/Geometry>
#include <cmath>

#include "common/base/parallel.h"

namespace tessera {

LabelImage RenderLabels(const TriangleMesh& mesh, const RayCaster& caster, const PosedCamera& camera) {
  LabelImage image(camera.intrinsics.width, camera.intrinsics.height, 1, 255);
  if (mesh.labels.empty()) return image;
  const Eigen::Vector3d centre = camera.Centre();
  ParallelForEach(image.height, 8, [&](int y) {
    for (int x = 0; x < image.width; ++x) {
      const RayHit hit = caster.Cast(centre, camera.Ray(x + 0.5, y + 0.5));
      if (!hit.hit()) continue;
      const int32_t label = mesh.labels[hit.face];
      if (label >= 0 && label < 255) image.at(x, y) = static_cast<uint8_t>(label);
    }
  });
  return image;
}

LabelImage UndistortLabels(const LabelImage& labels, const LensModel& lens) {
  const PinholeCamera& pinhole = lens.pinhole;
  if (lens.kind == LensModel::Kind::kPinhole && labels.width == pinhole.width && labels.height == pinhole.height) {
    return labels;
  }
  LabelImage image(pinhole.width, pinhole.height, 1, 255);
  const double scale_x = static_cast<double>(labels.width) / pinhole.width;
  const double scale_y = static_cast<double>(labels.height) / pinhole.height;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      Eigen::Vector2d p(x + 0.5, y + 0.5);
      if (lens.kind != LensModel::Kind::kPinhole) p = lens.Distort(p);
      const double sx = std::floor(p.x() * scale_x), sy = std::floor(p.y() * scale_y);
      if (sx >= 0 && sy >= 0 && sx < labels.width && sy < labels.height) {
        image.at(x, y) = labels.at(static_cast<int>(sx), static_cast<int>(sy));
      }
    }
  }
  return image;
}

}  // namespace tessera
