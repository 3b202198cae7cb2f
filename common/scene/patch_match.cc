#include "common/scene/patch_match.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace tessera {
namespace {

constexpr int kSide = 2 * kPatchRadius_px + 1, kPixels = kSide * kSide;
constexpr int kShifts = 2 * kSearchRadius_px + 1;
constexpr int kRandomPatches = 6;
constexpr double kLeastContrast = 0.012;  // standard deviation of luminance, in [0, 1]
// A maximum of the ZNCC is distinct if it is at least this high, and this much higher than all values more than two
// pixels away.
constexpr double kLeastPeak = 0.7, kLeastLead = 0.08;

// Bilinear; NaN outside the image. Pixel centres at +0.5.
float Sample(const FloatImage& image, double x, double y) {
  x -= 0.5;
  y -= 0.5;
  const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(std::floor(y));
  if (!(x0 >= 0 && y0 >= 0 && x0 + 1 < image.width && y0 + 1 < image.height)) return std::nanf("");
  const auto fx = static_cast<float>(x - x0), fy = static_cast<float>(y - y0);
  const float* const row = image.data.data() + static_cast<size_t>(y0) * image.width + x0;
  const float top = row[0] + fx * (row[1] - row[0]);
  const float bottom = row[image.width] + fx * (row[image.width + 1] - row[image.width]);
  return top + fy * (bottom - top);
}

Eigen::Matrix3d Intrinsics(const PinholeCamera& c) {
  Eigen::Matrix3d k;
  k << c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1;
  return k;
}

// Maps pixels of the reference to pixels of the other view through the tangent plane.
Eigen::Matrix3d PlaneHomography(const PosedCamera& reference, const PosedCamera& other, const SurfacePoint& point) {
  const Eigen::Matrix3d rotation = other.rotation_cam_from_world * reference.rotation_cam_from_world.transpose();
  const Eigen::Vector3d translation =
      other.translation_cam_from_world - rotation * reference.translation_cam_from_world;
  const Eigen::Vector3d normal = reference.rotation_cam_from_world * point.normal;
  const double distance = normal.dot(reference.CameraFromWorld(point.position));
  return Intrinsics(other.intrinsics) * (rotation + translation * normal.transpose() / distance) *
         Intrinsics(reference.intrinsics).inverse();
}

// A patch with mean zero and norm one. False without contrast or with pixels outside the image.
template <class Values>
bool Normalise(const Values& value, std::array<float, kPixels>* patch) {
  double sum = 0, squares = 0;
  for (int i = 0; i < kPixels; ++i) {
    const float v = value(i % kSide, i / kSide);
    (*patch)[i] = v;
    sum += v;
    squares += static_cast<double>(v) * v;
  }
  if (!std::isfinite(sum)) return false;
  const double mean = sum / kPixels, variance = squares / kPixels - mean * mean;
  if (variance < kLeastContrast * kLeastContrast) return false;
  const double scale = 1 / std::sqrt(variance * kPixels);
  for (float& v : *patch) v = static_cast<float>((v - mean) * scale);
  return true;
}

// ZNCC with a normalised patch; patches without contrast give 0.
template <class Values>
float Correlation(const std::array<float, kPixels>& patch, const Values& value) {
  double product = 0, sum = 0, squares = 0;
  for (int i = 0; i < kPixels; ++i) {
    const double v = value(i % kSide, i / kSide);
    product += patch[i] * v;
    sum += v;
    squares += v * v;
  }
  if (!std::isfinite(product)) return std::nanf("");
  const double variance = squares / kPixels - sum / kPixels * (sum / kPixels);
  if (variance < 1e-8) return 0;
  return static_cast<float>(product / std::sqrt(variance * kPixels));
}

double Vertex(float left, float middle, float right) {
  const double bend = left - 2.0 * middle + right;
  return bend < -1e-6 ? std::clamp(0.5 * (left - right) / bend, -0.5, 0.5) : 0;
}

uint32_t Next(uint32_t* state) { return *state = *state * 1664525u + 1013904223u; }

}  // namespace

std::optional<PatchMatch> MatchPatch(const PatchView& reference, const PatchView& other, const SurfacePoint& point,
                                     uint32_t seed) {
  const Eigen::Vector3d centre = reference.camera.Project(point.position);
  if (!reference.camera.InImage(centre)) return std::nullopt;
  const Eigen::Matrix3d homography = PlaneHomography(reference.camera, other.camera, point);
  const auto warp = [&](double x, double y) -> Eigen::Vector2d {
    const Eigen::Vector3d q = homography * Eigen::Vector3d(x, y, 1);
    return q.hnormalized();
  };
  const Eigen::Vector2d at = warp(centre.x(), centre.y());
  const Eigen::Vector2d right = warp(centre.x() + 1, centre.y()) - at, down = warp(centre.x(), centre.y() + 1) - at;
  const double area = std::abs(right.x() * down.y() - right.y() * down.x());
  if (!(area > 0.25 && area < 4)) return std::nullopt;

  std::array<float, kPixels> patch;
  if (!Normalise(
          [&](int x, int y) {
            return Sample(*reference.luminance, centre.x() + x - kPatchRadius_px, centre.y() + y - kPatchRadius_px);
          },
          &patch)) {
    return std::nullopt;
  }
  constexpr int kReach = kPatchRadius_px + kSearchRadius_px, kWide = 2 * kReach + 1;
  std::array<float, kWide * kWide> wide;
  for (int y = 0; y < kWide; ++y) {
    for (int x = 0; x < kWide; ++x) {
      const Eigen::Vector2d p = warp(centre.x() + x - kReach, centre.y() + y - kReach);
      wide[y * kWide + x] = Sample(*other.luminance, p.x(), p.y());
      if (!std::isfinite(wide[y * kWide + x])) return std::nullopt;
    }
  }
  std::array<float, kShifts * kShifts> score;
  int best = 0;
  for (int i = 0; i < kShifts * kShifts; ++i) {
    const int dx = i % kShifts, dy = i / kShifts;
    score[i] = Correlation(patch, [&](int x, int y) { return wide[(y + dy) * kWide + x + dx]; });
    if (score[i] > score[best]) best = i;
  }
  PatchMatch match;
  match.correlation = score[kShifts * kShifts / 2];
  match.best = score[best];
  const int bx = best % kShifts, by = best / kShifts;
  bool single = bx > 0 && by > 0 && bx + 1 < kShifts && by + 1 < kShifts && match.best >= kLeastPeak;
  for (int i = 0; single && i < kShifts * kShifts; ++i) {
    const bool near = std::abs(i % kShifts - bx) <= 2 && std::abs(i / kShifts - by) <= 2;
    single = near || score[i] < match.best - kLeastLead;
  }
  match.distinct = single;
  if (single) {
    match.shift_px = {bx - kSearchRadius_px + Vertex(score[best - 1], score[best], score[best + 1]),
                      by - kSearchRadius_px + Vertex(score[best - kShifts], score[best], score[best + kShifts])};
  }
  for (int i = 0; i < kRandomPatches; ++i) {
    const double angle = 2 * std::numbers::pi * (Next(&seed) >> 8) / (1 << 24);
    const double distance = 10 + 30.0 * (Next(&seed) >> 8) / (1 << 24);
    const double x0 = centre.x() + distance * std::cos(angle), y0 = centre.y() + distance * std::sin(angle);
    const float value = Correlation(patch, [&](int x, int y) {
      const Eigen::Vector2d p = warp(x0 + x - kPatchRadius_px, y0 + y - kPatchRadius_px);
      return Sample(*other.luminance, p.x(), p.y());
    });
    if (std::isfinite(value)) match.at_random.push_back(value);
  }
  // Content at a pixel of the reference is found in the other view where the true geometry maps it. Numerical
  // derivatives of that position, back in pixels of the reference.
  Eigen::Matrix2d jacobian;
  jacobian << right, down;
  const Eigen::Matrix2d back = jacobian.inverse();
  const auto derivative = [&](const PosedCamera& a, const PosedCamera& b, const SurfacePoint& p, double step) {
    const Eigen::Vector3d q = PlaneHomography(a, b, p) * Eigen::Vector3d(centre.x(), centre.y(), 1);
    return Eigen::Vector2d(back * (q.hnormalized() - at) / step);
  };
  constexpr double kStep = 1e-4;
  const auto refocused = [](PosedCamera camera) {
    camera.intrinsics.fx *= 1 + kStep, camera.intrinsics.fy *= 1 + kStep;
    return camera;
  };
  const double step_m = kStep * centre.z();
  SurfacePoint moved = point;
  moved.position += step_m * point.normal;
  match.by_surface = derivative(reference.camera, other.camera, moved, step_m);
  match.by_reference_focal = derivative(refocused(reference.camera), other.camera, point, kStep);
  match.by_other_focal = derivative(reference.camera, refocused(other.camera), point, kStep);
  const double length = match.by_surface.norm();
  if (!(length > 1e-9)) return std::nullopt;
  match.epipolar_dir = match.by_surface / length;
  return match;
}

}  // namespace tessera
