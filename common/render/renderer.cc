#include "common/render/renderer.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "common/base/parallel.h"
#include "common/base/random.h"

namespace tessera {
namespace {

// Light from the sky, the sun and the camera on an unoccluded surface that faces them.
constexpr float kSky = 0.45f, kSun = 0.4f, kFill = 0.25f;
constexpr double kOcclusionRange = 0.05;  // of the mesh's diagonal
constexpr double kRayOffset = 1e-4;       // offset of ray origins from the surface, relative to the camera's distance

double Diagonal(const TriangleMesh& mesh) {
  Eigen::AlignedBox3d box;
  for (const Triangle& face : mesh.faces) {
    for (uint32_t v : face) box.extend(mesh.vertices[v]);
  }
  return box.isEmpty() ? 0 : box.diagonal().norm();
}

struct Light {
  Eigen::Vector3d up, to_sun;
  double occlusion_range_m;
};

// Ambient occlusion: the unoccluded share of the hemisphere around `normal`, cosine-weighted.
float Openness(const RayCaster& caster, const Eigen::Vector3d& from, const Eigen::Vector3d& normal, int rays,
               double range_m, Random* random) {
  if (rays <= 0) return 1;
  const Eigen::Vector3d tangent = normal.unitOrthogonal(), other = normal.cross(tangent);
  int open = 0;
  for (int i = 0; i < rays; ++i) {
    const double radius = std::sqrt((i + random->Uniform()) / rays);
    const double angle = 2 * std::numbers::pi * random->Uniform();
    const Eigen::Vector3d direction = radius * std::cos(angle) * tangent + radius * std::sin(angle) * other +
                                      std::sqrt(std::max(0.0, 1 - radius * radius)) * normal;
    open += !caster.Occluded(from, from + range_m * direction, 0);
  }
  return static_cast<float>(open) / static_cast<float>(rays);
}

// Whether the point lies within half a pixel of one of the face's edges.
bool OnEdge(const TriangleMesh& mesh, size_t face, const Eigen::Vector3d& point, double pixel_m) {
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d& a = mesh.Corner(face, k);
    const Eigen::Vector3d edge = mesh.Corner(face, (k + 1) % 3) - a;
    const double length = edge.norm();
    if (length > 0 && edge.cross(point - a).norm() / length < 0.5 * pixel_m) return true;
  }
  return false;
}

}  // namespace

ByteImage Render(const TriangleMesh& mesh, const RayCaster& caster, const PosedCamera& camera,
                 const SurfaceColor& color, const RenderOptions& options) {
  const PinholeCamera& pinhole = camera.intrinsics;
  ByteImage image(pinhole.width, pinhole.height, 3);
  const Eigen::Vector3d centre = camera.Centre();
  const Eigen::Matrix3d world_from_cam = camera.rotation_cam_from_world.transpose();
  // The sun is to the left of, above and behind the camera.
  const Light light{options.up, (1.2 * options.up + world_from_cam * Eigen::Vector3d(-0.8, -0.3, -0.5)).normalized(),
                    kOcclusionRange * Diagonal(mesh)};
  const int side = std::max(1, options.samples_per_axis);

  const auto sample = [&](double x, double y, Random* random) -> Color {
    const Eigen::Vector3d ray = camera.Ray(x, y);
    const RayHit hit = caster.Cast(centre, ray);
    if (!hit.hit()) return Color(1, 1, 1);
    const size_t face = static_cast<size_t>(hit.face);
    const Eigen::Vector3d point = centre + hit.distance * ray;
    Color surface = color(face, point);
    if (options.edges && OnEdge(mesh, face, point, hit.distance / pinhole.fx)) surface *= 0.25f;
    if (!options.lit) return surface;
    Eigen::Vector3d normal = FaceNormal(mesh, face);
    if (normal.dot(ray) > 0) normal = -normal;
    const Eigen::Vector3d origin = point + kRayOffset * hit.distance * normal;
    const float open = Openness(caster, origin, normal, options.occlusion_rays, light.occlusion_range_m, random);
    const float sky = kSky * static_cast<float>(0.65 + 0.35 * normal.dot(light.up)) * open;
    const float sun = kSun * static_cast<float>(std::max(0.0, normal.dot(light.to_sun))) * (0.5f + 0.5f * open);
    const float fill = kFill * static_cast<float>(-normal.dot(ray) / ray.norm()) * open;
    return surface * (sky + sun + fill);
  };

  ParallelForEach(image.height, 4, [&](int y) {
    for (int x = 0; x < image.width; ++x) {
      Random random(static_cast<uint64_t>(y) * static_cast<uint64_t>(image.width) + static_cast<uint64_t>(x));
      Color sum = Color::Zero();
      for (int s = 0; s < side * side; ++s) {
        sum += sample(x + (s % side + 0.5) / side, y + (s / side + 0.5) / side, &random).cwiseMin(1.f).cwiseMax(0.f);
      }
      sum *= 255.f / static_cast<float>(side * side);
      for (int c = 0; c < 3; ++c) image.at(x, y, c) = static_cast<uint8_t>(std::lround(sum[c]));
    }
  });
  return image;
}

}  // namespace tessera
