#include "server/report_page/mesh_canvas.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "common/base/parallel.h"

namespace tessera {
namespace {

using Eigen::Vector3d, Eigen::Vector3f;

constexpr int kSide = 2;  // samples per pixel along each axis
constexpr int kOcclusionSamples = 10;
constexpr float kSkyLight = 0.47f, kSunLight = 0.42f, kCameraLight = 0.18f;
const Vector3f kBackground(0.925f, 0.938f, 0.95f);

PosedCamera Enlarged(PosedCamera camera) {
  PinholeCamera& k = camera.intrinsics;
  k = {kSide * k.width, kSide * k.height, kSide * k.fx, kSide * k.fy, kSide * k.cx, kSide * k.cy};
  return camera;
}

using DirectionsOfSample = std::array<Eigen::Vector2f, kOcclusionSamples>;

// Where each of the samples of a pixel looks for occluders: three turns of a spiral in the unit circle, turned from
// sample to sample.
const std::array<DirectionsOfSample, kSide * kSide>& Directions() {
  static const auto directions = [] {
    std::array<DirectionsOfSample, kSide * kSide> all;
    for (int s = 0; s < kSide * kSide; ++s) {
      const float turn = static_cast<float>(s) / (kSide * kSide);
      for (int i = 0; i < kOcclusionSamples; ++i) {
        const float share = (static_cast<float>(i) + turn + 0.1f) / kOcclusionSamples;
        const float angle = 2 * std::numbers::pi_v<float> * (3 * share + 0.25f * turn);
        all[s][i] = share * Eigen::Vector2f(std::cos(angle), std::sin(angle));
      }
    }
    return all;
  }();
  return directions;
}

}  // namespace

MeshCanvas::MeshCanvas(const PosedCamera& camera, const Vector3d& up, double occlusion_range_m)
    : camera_(Enlarged(camera)),
      principal_(static_cast<float>(camera_.intrinsics.cx - 0.5), static_cast<float>(camera_.intrinsics.cy - 0.5)),
      pixel_(static_cast<float>(1 / camera_.intrinsics.fx), static_cast<float>(1 / camera_.intrinsics.fy)),
      up_in_cam_((camera.rotation_cam_from_world * up).cast<float>()),
      occlusion_range_m_(static_cast<float>(occlusion_range_m)),
      inverse_depths_(static_cast<size_t>(camera_.intrinsics.width) * camera_.intrinsics.height, 0.0f),
      samples_(inverse_depths_.size()) {}

Vector3f MeshCanvas::PointAt(int x, int y, float inverse_depth) const {
  const float depth = 1 / inverse_depth;
  return {(static_cast<float>(x) - principal_.x()) * pixel_.x() * depth,
          (static_cast<float>(y) - principal_.y()) * pixel_.y() * depth, depth};
}

void MeshCanvas::Draw(const Vector3d& a, const Vector3d& b, const Vector3d& c, const FaceLook& look) {
  const PinholeCamera& k = camera_.intrinsics;
  const std::array<Vector3d, 3> p = {camera_.CameraFromWorld(a), camera_.CameraFromWorld(b),
                                     camera_.CameraFromWorld(c)};
  std::array<double, 3> x, y, w;  // w: inverse depth, linear in the image
  for (int i = 0; i < 3; ++i) {
    if (!(p[i].z() > 1e-6) || !p[i].allFinite()) return;
    w[i] = 1 / p[i].z();
    x[i] = k.fx * p[i].x() * w[i] + k.cx - 0.5;  // pixel centres at whole numbers
    y[i] = k.fy * p[i].y() * w[i] + k.cy - 0.5;
  }
  const auto bounds = [](const std::array<double, 3>& v, int size) {
    const auto [low, high] = std::minmax({v[0], v[1], v[2]});
    return std::pair(static_cast<int>(std::ceil(std::clamp(low, 0.0, 1.0 * size))),
                     static_cast<int>(std::floor(std::clamp(high, -1.0, size - 1.0))));
  };
  const auto [x_first, x_last] = bounds(x, k.width);
  const auto [y_first, y_last] = bounds(y, k.height);
  if (x_first > x_last || y_first > y_last) return;
  const double area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]);
  if (!(std::abs(area) > 0)) return;
  Vector3d normal = (p[1] - p[0]).cross(p[2] - p[0]).stableNormalized();
  if (normal.dot(p[0]) > 0) normal = -normal;
  for (int row = y_first; row <= y_last; ++row) {
    for (int column = x_first; column <= x_last; ++column) {
      const double u = ((x[2] - x[1]) * (row - y[1]) - (y[2] - y[1]) * (column - x[1])) / area;
      const double v = ((x[0] - x[2]) * (row - y[2]) - (y[0] - y[2]) * (column - x[2])) / area;
      if (!(u >= 0 && v >= 0 && u + v <= 1)) continue;
      const auto inverse_depth = static_cast<float>(u * w[0] + v * w[1] + (1 - u - v) * w[2]);
      const size_t at = static_cast<size_t>(row) * k.width + column;
      if (inverse_depth <= inverse_depths_[at]) continue;
      inverse_depths_[at] = inverse_depth;
      Sample& sample = samples_[at];
      sample.normal = normal.cast<float>();
      sample.look = look;
    }
  }
}

// The share of the sky that nearby surfaces leave open, from the depths of nearby samples (McGuire et al. 2011, "The
// Alchemy screen-space ambient obscurance algorithm").
float MeshCanvas::Openness(int x, int y) const {
  const PinholeCamera& k = camera_.intrinsics;
  const size_t here = static_cast<size_t>(y) * k.width + x;
  const Vector3f point = PointAt(x, y, inverse_depths_[here]), normal = samples_[here].normal;
  const float radius_px =
      std::clamp(static_cast<float>(k.fx) * occlusion_range_m_ * inverse_depths_[here], 4.0f, 120.0f);
  float sum = 0;
  for (const Eigen::Vector2f& direction : Directions()[(x % kSide) + kSide * (y % kSide)]) {
    const int to_x = x + static_cast<int>(radius_px * direction.x()),
              to_y = y + static_cast<int>(radius_px * direction.y());
    if (to_x < 0 || to_y < 0 || to_x >= k.width || to_y >= k.height) continue;
    const float inverse_depth = inverse_depths_[static_cast<size_t>(to_y) * k.width + to_x];
    if (inverse_depth <= 0) continue;
    const Vector3f away = PointAt(to_x, to_y, inverse_depth) - point;
    const float above = away.dot(normal);
    if (above <= 0 || away.squaredNorm() > occlusion_range_m_ * occlusion_range_m_) continue;
    const float distance = away.norm();
    const float sine = above / distance - 0.08f;  // the bias hides the faces of curved surfaces
    if (sine > 0) sum += sine * (1 - distance / occlusion_range_m_);
  }
  return std::clamp(1 - 2.8f * sum / kOcclusionSamples, 0.0f, 1.0f);
}

void MeshCanvas::Light() {
  const PinholeCamera& k = camera_.intrinsics;
  const Vector3f to_sun = (1.2f * up_in_cam_ + Vector3f(-0.8f, -0.3f, -0.5f)).normalized();
  ParallelForEach(k.height, 8, [&](int y) {
    for (int x = 0; x < k.width; ++x) {
      const size_t at = static_cast<size_t>(y) * k.width + x;
      if (inverse_depths_[at] <= 0) continue;
      Sample& sample = samples_[at];
      const float open = Openness(x, y);
      const Vector3f view = PointAt(x, y, inverse_depths_[at]).normalized();
      sample.light = kSkyLight * (0.65f + 0.35f * sample.normal.dot(up_in_cam_)) * open +
                     kSunLight * std::max(0.0f, sample.normal.dot(to_sun)) * (0.5f + 0.5f * open) +
                     kCameraLight * -sample.normal.dot(view) * open;
    }
  });
}

ByteImage MeshCanvas::Picture(const std::function<Vector3f(const FaceLook&)>& color) const {
  const PinholeCamera& k = camera_.intrinsics;
  ByteImage picture(k.width / kSide, k.height / kSide, 3);
  ParallelForEach(picture.height, 8, [&](int y) {
    for (int x = 0; x < picture.width; ++x) {
      Vector3f sum = Vector3f::Zero();
      for (int s = 0; s < kSide * kSide; ++s) {
        const size_t at = static_cast<size_t>(kSide * y + s / kSide) * k.width + kSide * x + s % kSide;
        const Sample& sample = samples_[at];
        sum += inverse_depths_[at] > 0 ? Vector3f((sample.light * color(sample.look)).cwiseMin(1.0f).cwiseMax(0.0f))
                                       : kBackground;
      }
      sum *= 255.0f / (kSide * kSide);
      for (int c = 0; c < 3; ++c) picture.at(x, y, c) = static_cast<uint8_t>(std::lround(sum[c]));
    }
  });
  return picture;
}

}  // namespace tessera
