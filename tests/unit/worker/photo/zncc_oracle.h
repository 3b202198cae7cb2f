// The kernel's computation in plain loops, one pixel at a time: in double precision as the reference, and in float
// for the expected accuracy.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "worker/photo/zncc_kernel.h"

namespace tessera {

template <class Real>
class ZnccOracle {
 public:
  // Adds one pair to gradient, curvature, count (width x height, no padding). `strip` must hold whole planes.
  ZnccOracle(const ZnccPair& pair, const ZnccWindow& window, float semantic_weight, const ReferenceStrip& strip)
      : pair_(pair),
        window_(window),
        semantic_weight_(semantic_weight),
        strip_(strip),
        width_(pair.reference->width),
        height_(pair.reference->height) {}

  std::vector<Real> gradient, curvature, count;
  ZnccSums sums;
  // Pixels where a decision, or the side of a bilinear cell's border, depends on less than `hair` pixels.
  std::vector<int> doubtful;
  Real hair = 0;

  void Run() {
    const size_t n = static_cast<size_t>(width_) * height_;
    for (std::vector<Real>* plane : {&gradient, &curvature, &count}) plane->resize(n, 0);
    for (std::vector<Real>* plane : {&mask_, &ref_, &other_, &slope_}) plane->assign(n, 0);
    classes_ =
        semantic_weight_ > 0 && pair_.reference->classes == pair_.other->texels->classes ? pair_.reference->classes : 0;
    for (int y = 0; y < height_; ++y) {
      for (int x = 0; x < width_; ++x) WarpPixel(x, y);
    }
    Score();
  }

 private:
  void WarpPixel(int x, int y) {
    const Real factor = strip_.depth_factor.row(y)[x], z = strip_.depth.row(y)[x];
    if (factor == 0) return;
    const Real xc = x + Real(0.5), yc = y + Real(0.5);
    Real m[3], q[3];
    for (int r = 0; r < 3; ++r) {
      m[r] = pair_.m[3 * r] * xc + pair_.m[3 * r + 1] * yc + pair_.m[3 * r + 2];
      q[r] = z * m[r] + pair_.t[r];
    }
    const Texels& other = *pair_.other->texels;
    if (q[2] <= 0) return;
    const Real u = q[0] / q[2], v = q[1] / q[2], us = u - Real(0.5), vs = v - Real(0.5);
    const bool inside = us >= 0 && vs >= 0 && us < other.width - 1 && vs < other.height - 1;
    const Real edge = std::max({-us, -vs, us - (other.width - 1), vs - (other.height - 1)});
    const size_t i = static_cast<size_t>(y) * width_ + x;
    if (hair > 0 && std::abs(edge) < hair) doubtful.push_back(static_cast<int>(i));
    if (!inside) return;
    const int cu = static_cast<int>(us), cv = static_cast<int>(vs);
    const Real a = us - cu, b = vs - cv;
    const Real nearest = pair_.other->Depth(static_cast<int>(u), static_cast<int>(v));
    const Real limit = nearest * (1 + Real(pair_.depth_slack));
    if (hair > 0 && (Close(2 * u) || Close(2 * v) || std::abs(q[2] - limit) < hair * q[2])) {
      doubtful.push_back(static_cast<int>(i));
    }
    if (q[2] > limit) return;
    if (!other.Valid(cu, cv) || !other.Valid(cu + 1, cv) || !other.Valid(cu, cv + 1) || !other.Valid(cu + 1, cv + 1)) {
      return;
    }
    const Real chain_u = (m[0] - u * m[2]) / q[2] * factor, chain_v = (m[1] - v * m[2]) / q[2] * factor;
    const auto sample = [&](Real p00, Real p10, Real p01, Real p11, Real* slope) {
      const Real du = (1 - b) * (p10 - p00) + b * (p11 - p01), dv = (1 - a) * (p01 - p00) + a * (p11 - p10);
      *slope = du * chain_u + dv * chain_v;
      return (1 - b) * ((1 - a) * p00 + a * p10) + b * ((1 - a) * p01 + a * p11);
    };
    const auto luminance = [&](int dx, int dy) { return Real(other.Luminance(cu + dx, cv + dy) - 0.5); };
    mask_[i] = 1;
    ref_[i] = Real(pair_.reference->Luminance(x, y) - 0.5);
    other_[i] = sample(luminance(0, 0), luminance(1, 0), luminance(0, 1), luminance(1, 1), &slope_[i]);
    if (classes_ == 0) return;
    Real e = 0, g = 0, h = 0;
    for (int l = 0; l < classes_; ++l) {
      const auto likelihood = [&](int dx, int dy) { return Real(other.Likelihood(cu + dx, cv + dy, l)); };
      Real slope;
      const Real at = sample(likelihood(0, 0), likelihood(1, 0), likelihood(0, 1), likelihood(1, 1), &slope);
      const Real difference = at - Real(pair_.reference->Likelihood(x, y, l));
      e += Real(0.5) * difference * difference;
      g += difference * slope;
      h += slope * slope;
    }
    sums.semantic_energy += static_cast<double>(e);
    sums.semantic_pixels += 1;
    gradient[i] += Real(semantic_weight_) * g;
    curvature[i] += Real(semantic_weight_) * h;
    count[i] += 1;
  }

  bool Close(Real value) const { return std::abs(value - std::round(value)) < 2 * hair; }

  // The weighted window sum around every pixel, first along columns, then along rows.
  std::vector<Real> WindowSum(const std::vector<Real>& in) const {
    std::vector<Real> down(in.size(), 0), out(in.size(), 0);
    const int radius = window_.radius;
    for (int y = 0; y < height_; ++y) {
      for (int k = std::max(-radius, -y); k <= radius && y + k < height_; ++k) {
        const Real tap = window_.taps[k + radius];
        const Real* from = in.data() + static_cast<size_t>(y + k) * width_;
        Real* to = down.data() + static_cast<size_t>(y) * width_;
        for (int x = 0; x < width_; ++x) to[x] += tap * from[x];
      }
      for (int x = 0; x < width_; ++x) {
        Real sum = 0;
        for (int k = std::max(-radius, -x); k <= radius && x + k < width_; ++k) {
          sum += Real(window_.taps[k + radius]) * down[static_cast<size_t>(y) * width_ + x + k];
        }
        out[static_cast<size_t>(y) * width_ + x] = sum;
      }
    }
    return out;
  }

  static std::vector<Real> Product(const std::vector<Real>& a, const std::vector<Real>& b) {
    std::vector<Real> out(a.size());
    for (size_t i = 0; i < a.size(); ++i) out[i] = a[i] * b[i];
    return out;
  }

  void Score() {
    const std::vector<Real> n = WindowSum(mask_), s1 = WindowSum(ref_), s2 = WindowSum(other_);
    const std::vector<Real> s11 = WindowSum(Product(ref_, ref_)), s22 = WindowSum(Product(other_, other_));
    const std::vector<Real> s12 = WindowSum(Product(ref_, other_));
    std::vector<Real> alpha(n.size(), 0), beta(n.size(), 0), gamma(n.size(), 0), eta(n.size(), 0);
    for (size_t i = 0; i < n.size(); ++i) {
      if (mask_[i] == 0 || n[i] < window_.min_valid) continue;
      const Real mu1 = s1[i] / n[i], mu2 = s2[i] / n[i];
      const Real v1 = s11[i] / n[i] - mu1 * mu1, v2 = s22[i] / n[i] - mu2 * mu2, c = s12[i] / n[i] - mu1 * mu2;
      if (!(v1 > window_.min_variance && v2 > window_.min_variance &&
            std::abs(mu1 - mu2) < window_.max_mean_difference && v1 < v2 * window_.max_variance_ratio &&
            v2 < v1 * window_.max_variance_ratio)) {
        continue;
      }
      const Real v1e = v1 + window_.epsilon, v2e = v2 + window_.epsilon, s = 1 / std::sqrt(v1e * v2e), zeta = c * s;
      const Real r = v1e / (v1e + window_.noise_variance), e = 1 - zeta, share = 1 / (1 + e / Real(window_.outlier));
      const Real rn = r * share * share / n[i];
      alpha[i] = -rn * s;
      beta[i] = rn * zeta / v2e;
      gamma[i] = rn * (mu1 * s - mu2 * zeta / v2e);
      eta[i] = rn / v2e;
      sums.energy += static_cast<double>(r * e * share);
      sums.weight += static_cast<double>(r);
      ++sums.windows;
      if (classes_ == 0) count[i] += 1;
    }
    const std::vector<Real> a = WindowSum(alpha), b = WindowSum(beta), g = WindowSum(gamma), h = WindowSum(eta);
    for (size_t i = 0; i < n.size(); ++i) {
      gradient[i] += (a[i] * ref_[i] + b[i] * other_[i] + g[i]) * slope_[i];
      curvature[i] += h[i] * slope_[i] * slope_[i];
    }
  }

  const ZnccPair& pair_;
  const ZnccWindow& window_;
  const float semantic_weight_;
  const ReferenceStrip& strip_;
  int width_, height_, classes_ = 0;
  std::vector<Real> mask_, ref_, other_, slope_;
};

}  // namespace tessera
