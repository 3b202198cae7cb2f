// Reference implementation of the data term of one ordered pair in double precision, itself verified by finite
// differences. Visibility, masks, accepted windows and their weights are frozen at construction.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/support/draw_views.h"
#include "worker/photo/photo_term.h"

namespace tessera {

class PhotoOracle {
 public:
  using Positions = std::vector<Eigen::Vector3d>;

  PhotoOracle(const TriangleMesh& mesh, const PhotoView& reference, const PhotoView& other, const PhotoOptions& options)
      : mesh_(mesh),
        reference_(reference.camera),
        image_(reference.texels),
        other_(other.camera),
        other_image_(other.texels),
        options_(options),
        map_(RasterizeFaces(mesh, reference.camera)) {
    if (options.semantic_weight > 0 && image_.classes == other_image_.classes) classes_ = image_.classes;
    const FaceMap other_map = RasterizeFaces(mesh, other.camera);
    const int count = map_.width * map_.height;
    mask_.assign(count, false);
    accepted_.assign(count, false);
    weight_.assign(count, 0);
    for (int i = 0; i < count; ++i) mask_[i] = Visible(i, other_map);
    const std::vector<Sample> samples = Warp(mesh.vertices);
    for (int i = 0; i < count; ++i) {
      if (!mask_[i]) continue;
      const Window w = Stats(i, samples);
      const ZnccWindow& o = options_.window;
      const double v1 = w.v1 - o.epsilon, v2 = w.v2 - o.epsilon;
      accepted_[i] = w.n >= o.min_valid && v1 > o.min_variance && v2 > o.min_variance &&
                     std::abs(w.mu1 - w.mu2) < o.max_mean_difference && v1 < v2 * o.max_variance_ratio &&
                     v2 < v1 * o.max_variance_ratio;
      weight_[i] = w.v1 / (w.v1 + o.noise_variance);
    }
  }

  int accepted_windows() const { return static_cast<int>(std::count(accepted_.begin(), accepted_.end(), true)); }
  int masked_pixels() const { return static_cast<int>(std::count(mask_.begin(), mask_.end(), true)); }

  double PhotoEnergy(const Positions& v) const {
    const std::vector<Sample> samples = Warp(v);
    double energy = 0;
    for (size_t i = 0; i < accepted_.size(); ++i) {
      if (!accepted_[i]) continue;
      const Window w = Stats(static_cast<int>(i), samples);
      const double e = 1 - w.c / std::sqrt(w.v1 * w.v2);
      energy += weight_[i] * e / (1 + e / options_.window.outlier);
    }
    return energy;
  }
  // Without its weight.
  double SemanticEnergy(const Positions& v) const {
    const std::vector<Sample> samples = Warp(v);
    double energy = 0;
    for (size_t i = 0; i < mask_.size(); ++i) {
      if (!mask_[i]) continue;
      energy += SemanticAt(static_cast<int>(i), samples[i]).energy;
    }
    return energy;
  }
  double Energy(const Positions& v) const {
    return PhotoEnergy(v) + (classes_ > 0 ? options_.semantic_weight * SemanticEnergy(v) : 0);
  }

  // Wrong formulas, each of which the gradient test must detect.
  enum Fault {
    kNone,
    kPointwise,      // treats a pixel as moving alone in its own window, as widely used code does
    kNoOutlier,      // leaves out the derivative of the outlier function
    kOneClassFewer,  // forgets the last class
    kNoPerspective,  // leaves out the motion of the other view's depth
    kNearestTexel,   // takes the slope of the other image at the cell's corner
  };
  Positions Gradient(const Positions& v, Fault fault = kNone) const {
    const bool pointwise = fault == kPointwise;
    const std::vector<Sample> samples = Warp(v, fault);
    const int radius = options_.window.radius;
    std::vector<double> derivative(mask_.size(), 0);  // of the energy by I_ij(x)
    for (int i = 0; i < static_cast<int>(accepted_.size()); ++i) {
      if (!accepted_[i]) continue;
      const Window w = Stats(i, samples);
      const double s = 1 / std::sqrt(w.v1 * w.v2), zeta = w.c * s;
      const double share = fault == kNoOutlier ? 1 : 1 / (1 + (1 - zeta) / options_.window.outlier);
      const double r = weight_[i] * share * share;
      const int cx = i % map_.width, cy = i / map_.width;
      for (int dy = -radius; dy <= radius; ++dy) {
        for (int dx = -radius; dx <= radius; ++dx) {
          if (pointwise && (dx != 0 || dy != 0)) continue;
          const int x = cx + dx, y = cy + dy;
          if (x < 0 || y < 0 || x >= map_.width || y >= map_.height || !mask_[y * map_.width + x]) continue;
          const double tap = pointwise ? 1 : Tap(dx, dy);
          const Sample& sample = samples[y * map_.width + x];
          derivative[y * map_.width + x] -=
              r * tap / w.n * ((image_.Luminance(x, y) - w.mu1) * s - zeta * (sample.value - w.mu2) / w.v2);
        }
      }
    }
    // From by I_ij to by depth, and E_sem, which needs no window.
    for (size_t i = 0; i < mask_.size(); ++i) {
      if (!mask_[i]) continue;
      derivative[i] *= samples[i].slope_z;
      if (classes_ == 0) continue;
      const Semantic at = SemanticAt(static_cast<int>(i), samples[i], fault == kOneClassFewer ? 1 : 0);
      derivative[i] += options_.semantic_weight * at.derivative_z;
    }
    Positions gradient(v.size(), Eigen::Vector3d::Zero());
    for (size_t i = 0; i < mask_.size(); ++i) {
      if (!mask_[i] || derivative[i] == 0) continue;
      const Triangle& face = mesh_.faces[map_.face[i]];
      const Eigen::Vector3d n = (v[face[1]] - v[face[0]]).cross(v[face[2]] - v[face[0]]);
      const Eigen::Vector3d ray = Ray(static_cast<int>(i));
      const Eigen::Vector3d hit = reference_.Centre() + samples[i].z * ray;
      for (int k = 0; k < 3; ++k) {
        const double phi = n.dot((v[face[(k + 1) % 3]] - hit).cross(v[face[(k + 2) % 3]] - hit)) / n.squaredNorm();
        gradient[face[k]] += derivative[i] * phi / n.dot(ray) * n;
      }
    }
    return gradient;
  }

 private:
  struct Sample {
    double z = 0, value = 0, slope_z = 0;  // depth of the hit, I_j there, dI_j/dz along the reference's ray
    double u = 0, v = 0, du = 0, dv = 0;   // where it lands, in pixels from the first pixel's centre, and by z
  };
  struct Semantic {
    double energy = 0, derivative_z = 0;
  };
  struct Window {
    double n = 0, mu1 = 0, mu2 = 0, v1 = 0, v2 = 0, c = 0;
  };

  double Tap(int dx, int dy) const {
    const ZnccWindow& w = options_.window;
    return static_cast<double>(w.taps[dx + w.radius]) * w.taps[dy + w.radius];
  }
  Eigen::Vector3d Ray(int i) const { return reference_.Ray(i % map_.width + 0.5, i / map_.width + 0.5); }

  bool Visible(int i, const FaceMap& other_map) const {
    const int32_t f = map_.face[i];
    if (f < 0 || !image_.Valid(i % map_.width, i / map_.width)) return false;
    const Eigen::Vector3d ray = Ray(i);
    if (FaceNormal(mesh_, f).dot(ray.normalized()) >= -static_cast<double>(kMinRayCosine)) return false;
    const Eigen::Vector3d p = other_.Project(reference_.Centre() + Depth(mesh_.vertices, i) * ray);
    if (p.z() <= 0 || p.x() < 0.5 || p.y() < 0.5 || p.x() >= other_image_.width - 0.5 ||
        p.y() >= other_image_.height - 0.5) {
      return false;
    }
    const double slack = 1 + options_.occlusion_px / other_.intrinsics.fx;
    const double nearest = other_map.depth[static_cast<int>(p.y()) * other_map.width + static_cast<int>(p.x())];
    return p.z() <= nearest * slack && CellIsValid(p.x() - 0.5, p.y() - 0.5);
  }

  double Depth(const Positions& v, int i) const {
    const Triangle& face = mesh_.faces[map_.face[i]];
    const Eigen::Vector3d n = (v[face[1]] - v[face[0]]).cross(v[face[2]] - v[face[0]]);
    return n.dot(v[face[0]] - reference_.Centre()) / n.dot(Ray(i));
  }

  struct Interpolated {
    double value, du, dv;
  };
  // Bilinear, of texel values `at(x, y)`.
  template <class At>
  Interpolated Interpolate(double u, double v, const At& at) const {
    const int x = static_cast<int>(u), y = static_cast<int>(v);
    const double a = u - x, b = v - y;
    const double p00 = at(x, y), p10 = at(x + 1, y), p01 = at(x, y + 1), p11 = at(x + 1, y + 1);
    return {(1 - b) * ((1 - a) * p00 + a * p10) + b * ((1 - a) * p01 + a * p11),
            (1 - b) * (p10 - p00) + b * (p11 - p01), (1 - a) * (p01 - p00) + a * (p11 - p10)};
  }
  bool CellIsValid(double u, double v) const {
    const int x = static_cast<int>(u), y = static_cast<int>(v);
    return other_image_.Valid(x, y) && other_image_.Valid(x + 1, y) && other_image_.Valid(x, y + 1) &&
           other_image_.Valid(x + 1, y + 1);
  }

  Semantic SemanticAt(int i, const Sample& sample, int classes_forgotten = 0) const {
    Semantic out;
    for (int l = 0; l < classes_; ++l) {
      const Interpolated at =
          Interpolate(sample.u, sample.v, [&](int x, int y) { return other_image_.Likelihood(x, y, l); });
      const double difference = at.value - image_.Likelihood(i % map_.width, i / map_.width, l);
      out.energy += 0.5 * difference * difference;
      if (l + classes_forgotten < classes_) out.derivative_z += difference * (at.du * sample.du + at.dv * sample.dv);
    }
    return out;
  }

  std::vector<Sample> Warp(const Positions& v, Fault fault = kNone) const {
    std::vector<Sample> out(mask_.size());
    for (size_t i = 0; i < mask_.size(); ++i) {
      if (!mask_[i]) continue;
      const Eigen::Vector3d ray = Ray(static_cast<int>(i));
      Sample& sample = out[i];
      sample.z = Depth(v, static_cast<int>(i));
      const Eigen::Vector3d q = other_.CameraFromWorld(reference_.Centre() + sample.z * ray);
      const Eigen::Vector3d dq = other_.rotation_cam_from_world * ray;
      const double dz = fault == kNoPerspective ? 0 : dq.z();
      const PinholeCamera& k = other_.intrinsics;
      sample.u = k.fx * q.x() / q.z() + k.cx - 0.5;
      sample.v = k.fy * q.y() / q.z() + k.cy - 0.5;
      sample.du = k.fx * (dq.x() * q.z() - q.x() * dz) / (q.z() * q.z());
      sample.dv = k.fy * (dq.y() * q.z() - q.y() * dz) / (q.z() * q.z());
      const auto luminance = [&](int x, int y) { return other_image_.Luminance(x, y); };
      const Interpolated at = Interpolate(sample.u, sample.v, luminance);
      const Interpolated corner = Interpolate(std::floor(sample.u), std::floor(sample.v), luminance);
      const Interpolated& slope = fault == kNearestTexel ? corner : at;
      sample.value = at.value;
      sample.slope_z = slope.du * sample.du + slope.dv * sample.dv;
    }
    return out;
  }

  Window Stats(int i, const std::vector<Sample>& samples) const {
    const int radius = options_.window.radius, cx = i % map_.width, cy = i / map_.width;
    Window w;
    double s1 = 0, s2 = 0, s11 = 0, s22 = 0, s12 = 0;
    for (int dy = -radius; dy <= radius; ++dy) {
      for (int dx = -radius; dx <= radius; ++dx) {
        const int x = cx + dx, y = cy + dy;
        if (x < 0 || y < 0 || x >= map_.width || y >= map_.height || !mask_[y * map_.width + x]) continue;
        const double tap = Tap(dx, dy), a = image_.Luminance(x, y), b = samples[y * map_.width + x].value;
        w.n += tap;
        s1 += tap * a;
        s2 += tap * b;
        s11 += tap * a * a;
        s22 += tap * b * b;
        s12 += tap * a * b;
      }
    }
    w.mu1 = s1 / w.n;
    w.mu2 = s2 / w.n;
    w.v1 = s11 / w.n - w.mu1 * w.mu1 + options_.window.epsilon;
    w.v2 = s22 / w.n - w.mu2 * w.mu2 + options_.window.epsilon;
    w.c = s12 / w.n - w.mu1 * w.mu2;
    return w;
  }

  const TriangleMesh& mesh_;
  PosedCamera reference_;
  const Texels& image_;
  PosedCamera other_;
  const Texels& other_image_;
  PhotoOptions options_;
  FaceMap map_;
  int classes_ = 0;  // of E_sem
  std::vector<bool> mask_, accepted_;
  std::vector<double> weight_;
};

}  // namespace tessera
