#include "common/check/patch_match.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
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

// A row of the search region, and of its scores, in whole vectors of four floats.
constexpr int kReach = kPatchRadius_px + kSearchRadius_px, kWide = 2 * kReach + 1, kWideStride = kWide + 3;
constexpr int kShiftStride = kShifts + 3;

using Patch = std::array<float, kPixels>;

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

// Samples another image at the pixels of the reference around `centre`.
class WarpedImage {
 public:
  WarpedImage(const FloatImage& image, const Eigen::Matrix3d& homography, const Eigen::Vector2d& centre)
      : image_(image), homography_(homography), origin_(At(centre)) {
    // Relative to the image of `centre`, so that floats are exact enough: offset = (rows_ d) / (w d + w0).
    const Eigen::Vector3d q = homography * centre.homogeneous();
    rows_ = homography.topLeftCorner<2, 2>() - origin_ * homography.bottomLeftCorner<1, 2>();
    w_ = homography.bottomLeftCorner<1, 2>();
    w0_ = q.z();
  }

  Eigen::Vector2d At(const Eigen::Vector2d& p) const { return (homography_ * p.homogeneous()).hnormalized(); }

  // Writes the square of (2 radius + 1) x (2 radius + 1) pixels around centre + `shift`, bilinear, rows `stride` apart.
  // False if a part of it is outside the image or not a number.
  template <int kRadius>
  bool Sample(const Eigen::Vector2d& shift, int stride, float* values) const {
    constexpr int kCount = 2 * kRadius + 1;
    const Eigen::Vector2d middle = Offset(shift);
    Eigen::Vector2d low = middle, high = middle;
    for (const double x : {-kRadius, kRadius}) {
      for (const double y : {-kRadius, kRadius}) {
        const Eigen::Vector2d d = shift + Eigen::Vector2d(x, y);
        if (!(w_.dot(d) + w0_ > 0) == (w0_ > 0)) return false;
        low = low.cwiseMin(Offset(d));
        high = high.cwiseMax(Offset(d));
      }
    }
    // The image of a square is a convex quadrilateral: what its corners satisfy, all its pixels do. A margin covers the
    // rounding of floats.
    const Eigen::Vector2d first = origin_ + low, last = origin_ + high;
    if (!(first.x() > 0.51 && first.y() > 0.51 && last.x() < image_.width - 0.51 && last.y() < image_.height - 0.51)) {
      return false;
    }
    const int x0 = static_cast<int>(first.x() - 0.51), y0 = static_cast<int>(first.y() - 0.51);
    const auto from_x = static_cast<float>(origin_.x() - 0.5 - x0), from_y = static_cast<float>(origin_.y() - 0.5 - y0);
    const float* const base = image_.data.data() + static_cast<size_t>(y0) * image_.width + x0;
    const auto ax = static_cast<float>(rows_(0, 0)), ay = static_cast<float>(rows_(1, 0));
    const auto aw = static_cast<float>(w_.x());
    float sums[kCount] = {};  // not finite if a value is not
    for (int row = 0; row < kCount; ++row) {
      const Eigen::Vector2d d = shift + Eigen::Vector2d(-kRadius, row - kRadius);
      const auto bx = static_cast<float>(rows_.row(0).dot(d)), by = static_cast<float>(rows_.row(1).dot(d));
      const auto bw = static_cast<float>(w_.dot(d) + w0_);
      float fx[kCount], fy[kCount];
      int at[kCount];
      for (int i = 0; i < kCount; ++i) {
        const float scale = 1 / (bw + aw * static_cast<float>(i));
        const float x = from_x + (bx + ax * static_cast<float>(i)) * scale;
        const float y = from_y + (by + ay * static_cast<float>(i)) * scale;
        const int column = static_cast<int>(x), line = static_cast<int>(y);
        fx[i] = x - static_cast<float>(column);
        fy[i] = y - static_cast<float>(line);
        at[i] = line * image_.width + column;
      }
      for (int i = 0; i < kCount; ++i) {
        const float* const p = base + at[i];
        const float top = p[0] + fx[i] * (p[1] - p[0]);
        const float bottom = p[image_.width] + fx[i] * (p[image_.width + 1] - p[image_.width]);
        values[row * stride + i] = top + fy[i] * (bottom - top);
        sums[i] += values[row * stride + i];
      }
    }
    return std::all_of(std::begin(sums), std::end(sums), [](float sum) { return std::isfinite(sum); });
  }

 private:
  Eigen::Vector2d Offset(const Eigen::Vector2d& d) const { return rows_ * d / (w_.dot(d) + w0_); }

  const FloatImage& image_;
  const Eigen::Matrix3d homography_;
  const Eigen::Vector2d origin_;
  Eigen::Matrix2d rows_;
  Eigen::Vector2d w_;
  double w0_ = 0;
};

// Gives the patch mean zero and norm one. False without contrast.
bool Normalise(Patch* patch) {
  double sum = 0, squares = 0;
  for (const float v : *patch) {
    sum += v;
    squares += static_cast<double>(v) * v;
  }
  const double mean = sum / kPixels, variance = squares / kPixels - mean * mean;
  if (!(variance >= kLeastContrast * kLeastContrast)) return false;
  const double scale = 1 / std::sqrt(variance * kPixels);
  for (float& v : *patch) v = static_cast<float>((v - mean) * scale);
  return true;
}

// The ZNCC of a normalised patch with one whose inner product with it, sum and sum of squares these are. 0 without
// contrast.
float Zncc(double product, double sum, double squares) {
  const double mean = sum / kPixels, variance = squares / kPixels - mean * mean;
  return variance < 1e-8 ? 0 : static_cast<float>(product / std::sqrt(variance * kPixels));
}

float Correlation(const Patch& patch, const Patch& other) {
  double product = 0, sum = 0, squares = 0;
  for (int i = 0; i < kPixels; ++i) {
    const double v = other[i];
    product += patch[i] * v;
    sum += v;
    squares += v * v;
  }
  return Zncc(product, sum, squares);
}

// The ZNCC of `patch` at all shifts inside `wide` (kWide rows of kWideStride).
std::array<float, kShifts * kShifts> Correlations(const Patch& patch, const float* wide) {
  std::array<float, kShifts * kShifts> scores;
  double columns[kWide] = {}, column_squares[kWide] = {};  // sums over the kSide rows of a shift
  const auto add_row = [&](int row, double sign) {
    for (int x = 0; x < kWide; ++x) {
      const double v = wide[row * kWideStride + x];
      columns[x] += sign * v;
      column_squares[x] += sign * v * v;
    }
  };
  for (int row = 0; row < kSide - 1; ++row) add_row(row, 1);
  for (int dy = 0; dy < kShifts; ++dy) {
    add_row(dy + kSide - 1, 1);
    float products[kShiftStride] = {};  // the last ones are unused
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        const float v = patch[y * kSide + x];
        const float* const row = wide + (dy + y) * kWideStride + x;
        for (int dx = 0; dx < kShiftStride; ++dx) products[dx] += v * row[dx];
      }
    }
    double sum = 0, squares = 0;
    for (int x = 0; x < kSide - 1; ++x) sum += columns[x], squares += column_squares[x];
    for (int dx = 0; dx < kShifts; ++dx) {
      sum += columns[dx + kSide - 1];
      squares += column_squares[dx + kSide - 1];
      scores[dy * kShifts + dx] = Zncc(products[dx], sum, squares);
      sum -= columns[dx];
      squares -= column_squares[dx];
    }
    add_row(dy, -1);
  }
  return scores;
}

// A patch of the reference around `centre`, and the other image warped onto it.
struct WarpedPatch {
  Eigen::Vector3d centre;
  Patch patch;
  WarpedImage warped;
  Eigen::Vector2d at, right, down;  // position in the other image, and its derivatives by the pixels of the reference
};

std::optional<WarpedPatch> WarpPatch(const PatchView& reference, const PatchView& other, const SurfacePoint& point) {
  const Eigen::Vector3d centre = reference.camera.Project(point.position);
  if (!reference.camera.InImage(centre)) return std::nullopt;
  const WarpedImage warped(*other.luminance, PlaneHomography(reference.camera, other.camera, point), centre.head<2>());
  const Eigen::Vector2d at = warped.At(centre.head<2>());
  const Eigen::Vector2d right = warped.At({centre.x() + 1, centre.y()}) - at;
  const Eigen::Vector2d down = warped.At({centre.x(), centre.y() + 1}) - at;
  const double area = std::abs(right.x() * down.y() - right.y() * down.x());
  if (!(area > 0.25 && area < 4)) return std::nullopt;
  Patch patch;
  const WarpedImage unwarped(*reference.luminance, Eigen::Matrix3d::Identity(), centre.head<2>());
  if (!unwarped.Sample<kPatchRadius_px>({0, 0}, kSide, patch.data()) || !Normalise(&patch)) return std::nullopt;
  return WarpedPatch{centre, patch, warped, at, right, down};
}

double Vertex(float left, float middle, float right) {
  const double bend = left - 2.0 * middle + right;
  return bend < -1e-6 ? std::clamp(0.5 * (left - right) / bend, -0.5, 0.5) : 0;
}

uint32_t Next(uint32_t* state) { return *state = *state * 1664525u + 1013904223u; }

// PatchMatch::at_random.
std::vector<float> RandomCorrelations(const WarpedPatch& made, uint32_t seed) {
  std::vector<float> correlations;
  for (int i = 0; i < kRandomPatches; ++i) {
    const double angle = 2 * std::numbers::pi * (Next(&seed) >> 8) / (1 << 24);
    const double distance = 10 + 30.0 * (Next(&seed) >> 8) / (1 << 24);
    const Eigen::Vector2d shift(distance * std::cos(angle), distance * std::sin(angle));
    Patch random;
    if (!made.warped.Sample<kPatchRadius_px>(shift, kSide, random.data())) continue;
    correlations.push_back(Correlation(made.patch, random));
  }
  return correlations;
}

float CorrelationOf(const std::optional<WarpedPatch>& made) {
  Patch seen;
  if (!made || !made->warped.Sample<kPatchRadius_px>({0, 0}, kSide, seen.data())) return std::nanf("");
  return Correlation(made->patch, seen);
}

}  // namespace

std::optional<PatchMatch> MatchPatch(const PatchView& reference, const PatchView& other, const SurfacePoint& point,
                                     uint32_t seed) {
  const std::optional<WarpedPatch> made = WarpPatch(reference, other, point);
  if (!made) return std::nullopt;
  const auto& [centre, patch, warped, at, right, down] = *made;
  std::array<float, kWide* kWideStride> wide = {};
  if (!warped.Sample<kReach>({0, 0}, kWideStride, wide.data())) return std::nullopt;
  const std::array<float, kShifts* kShifts> score = Correlations(patch, wide.data());
  int best = 0;
  for (int i = 0; i < kShifts * kShifts; ++i) {
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
  match.at_random = RandomCorrelations(*made, seed);
  // Content at a pixel of the reference is found in the other view where the true geometry maps it. Numerical
  // derivatives of that position, back in pixels of the reference.
  Eigen::Matrix2d jacobian;
  jacobian << right, down;
  const Eigen::Matrix2d back = jacobian.inverse();
  const auto derivative = [&back, centre = centre, at = at](const PosedCamera& a, const PosedCamera& b,
                                                           const SurfacePoint& p, double step) {
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

float CorrelatePatch(const PatchView& reference, const PatchView& other, const SurfacePoint& point) {
  return CorrelationOf(WarpPatch(reference, other, point));
}

std::optional<PatchCorrelation> CorrelateAtRandom(const PatchView& reference, const PatchView& other,
                                                  const SurfacePoint& point, uint32_t seed) {
  const std::optional<WarpedPatch> made = WarpPatch(reference, other, point);
  const float correlation = CorrelationOf(made);
  if (std::isnan(correlation)) return std::nullopt;
  return PatchCorrelation{correlation, RandomCorrelations(*made, seed)};
}

}  // namespace tessera
