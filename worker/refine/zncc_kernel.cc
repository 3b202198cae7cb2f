#include "worker/refine/zncc_kernel.h"

#include <algorithm>
#include <cmath>

// One instruction-set level for all machines that have it: results must agree to the bit.
#define HWY_DISABLED_TARGETS (HWY_AVX3 | HWY_AVX3_DL)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "worker/refine/zncc_kernel.cc"
#include <hwy/foreach_target.h>
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace tessera {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Tag = hn::ScalableTag<float>;
using Vec = hn::Vec<Tag>;

// Rows of the pipeline for one strip, each with kEdge zeros before pixel 0 and after the last vector.
class Rows {
 public:
  static constexpr int kEdge = 16;
  enum Plane { kMask, kRef, kOther, kSlope, kAlpha, kBeta, kGamma, kEta, kRingPlanes };
  static constexpr int kLinePlanes = 6;

  Rows(int width, int ring, ZnccScratch* scratch) : ring_(ring) {
    stride_ = (width + 15) / 16 * 16 + 2 * kEdge;
    const size_t size = static_cast<size_t>(stride_) * (ring_ * kRingPlanes + kLinePlanes);
    scratch->data.assign(size, 0.0f);
    base_ = scratch->data.data();
  }
  float* Ring(Plane plane, int y) {
    return base_ + stride_ * static_cast<size_t>(plane * ring_ + ((y % ring_) + ring_) % ring_) + kEdge;
  }
  float* Line(int i) { return base_ + stride_ * static_cast<size_t>(ring_ * kRingPlanes + i) + kEdge; }
  void Clear(Plane plane, int y) { std::fill_n(Ring(plane, y) - kEdge, stride_, 0.0f); }

 private:
  size_t stride_ = 0;
  int ring_ = 0;
  float* base_ = nullptr;
};

// Warps row y of the reference into the other image: mask, both luminances under it, and the slope dI_j/d(offset).
void WarpRow(const ZnccPair& pair, int y, Rows& rows) {
  const Tag d;
  const hn::RebindToSigned<Tag> di;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const PaddedPlane& other = *pair.other;
  const float yc = static_cast<float>(y) + 0.5f;
  const Vec row0 = hn::Set(d, pair.m[1] * yc + pair.m[2]);
  const Vec row1 = hn::Set(d, pair.m[4] * yc + pair.m[5]);
  const Vec row2 = hn::Set(d, pair.m[7] * yc + pair.m[8]);
  const Vec m0x = hn::Set(d, pair.m[0]), m1x = hn::Set(d, pair.m[3]), m2x = hn::Set(d, pair.m[6]);
  const Vec t0 = hn::Set(d, pair.t[0]), t1 = hn::Set(d, pair.t[1]), t2 = hn::Set(d, pair.t[2]);
  const Vec half = hn::Set(d, 0.5f), one = hn::Set(d, 1.0f), zero = hn::Zero(d);
  const Vec u_max = hn::Set(d, static_cast<float>(other.width) - 0.5f);
  const Vec v_max = hn::Set(d, static_cast<float>(other.height) - 0.5f);
  const Vec slack = hn::Set(d, 1.0f + pair.depth_slack);
  const auto stride = hn::Set(di, other.stride), width = hn::Set(di, other.width), right = hn::Set(di, 1);
  const float* z_row = pair.depth->row(y);
  const float* factor_row = pair.depth_factor->row(y);
  const float* ref_row = pair.reference->row(y);
  float* out_mask = rows.Ring(Rows::kMask, y);
  float* out_ref = rows.Ring(Rows::kRef, y);
  float* out_other = rows.Ring(Rows::kOther, y);
  float* out_slope = rows.Ring(Rows::kSlope, y);
  const Vec ramp = hn::Iota(d, 0.5f);
  for (int x = 0; x < pair.reference->width; x += lanes) {
    const Vec factor = hn::LoadU(d, factor_row + x);
    auto mask = hn::Ne(factor, zero);
    if (hn::AllFalse(d, mask)) {
      hn::StoreU(zero, d, out_mask + x);
      hn::StoreU(zero, d, out_ref + x);
      hn::StoreU(zero, d, out_other + x);
      hn::StoreU(zero, d, out_slope + x);
      continue;
    }
    const Vec z = hn::IfThenElse(mask, hn::LoadU(d, z_row + x), one);
    const Vec xc = hn::Add(ramp, hn::Set(d, static_cast<float>(x)));
    const Vec m0 = hn::MulAdd(m0x, xc, row0), m1 = hn::MulAdd(m1x, xc, row1), m2 = hn::MulAdd(m2x, xc, row2);
    const Vec q2 = hn::MulAdd(z, m2, t2);
    mask = hn::And(mask, hn::Gt(q2, zero));
    const Vec inverse = hn::Div(one, hn::IfThenElse(mask, q2, one));
    const Vec u = hn::Mul(hn::MulAdd(z, m0, t0), inverse), v = hn::Mul(hn::MulAdd(z, m1, t1), inverse);
    mask =
        hn::And(mask, hn::And(hn::And(hn::Ge(u, half), hn::Lt(u, u_max)), hn::And(hn::Ge(v, half), hn::Lt(v, v_max))));
    const Vec us = hn::IfThenElse(mask, u, half), vs = hn::IfThenElse(mask, v, half);
    // Bilinear cell about (u, v), whose corners are pixel centres.
    const Vec uc = hn::Sub(us, half), vc = hn::Sub(vs, half);
    const auto iu = hn::ConvertTo(di, uc), iv = hn::ConvertTo(di, vc);
    const Vec a = hn::Sub(uc, hn::ConvertTo(d, iu)), b = hn::Sub(vc, hn::ConvertTo(d, iv));
    const auto top = hn::Add(hn::Mul(iv, stride), iu), bottom = hn::Add(top, stride);
    const Vec p00 = hn::GatherIndex(d, other.data.data(), top);
    const Vec p10 = hn::GatherIndex(d, other.data.data(), hn::Add(top, right));
    const Vec p01 = hn::GatherIndex(d, other.data.data(), bottom);
    const Vec p11 = hn::GatherIndex(d, other.data.data(), hn::Add(bottom, right));
    const auto nearest = hn::Add(hn::Mul(hn::ConvertTo(di, vs), width), hn::ConvertTo(di, us));
    const Vec other_z = hn::GatherIndex(d, pair.other_depth, nearest);
    const Vec dx_top = hn::Sub(p10, p00), dx_bottom = hn::Sub(p11, p01);
    const Vec i_top = hn::MulAdd(a, dx_top, p00), i_bottom = hn::MulAdd(a, dx_bottom, p01);
    const Vec dv = hn::Sub(i_bottom, i_top);
    const Vec value = hn::MulAdd(b, dv, i_top);
    const Vec du = hn::MulAdd(b, hn::Sub(dx_bottom, dx_top), dx_top);
    mask = hn::And(mask, hn::And(hn::Eq(value, value), hn::Le(q2, hn::Mul(other_z, slack))));
    // dI/dz along the ray, then per metre of the face's offset.
    const Vec along = hn::MulAdd(du, hn::NegMulAdd(u, m2, m0), hn::Mul(dv, hn::NegMulAdd(v, m2, m1)));
    const Vec slope = hn::Mul(hn::Mul(along, inverse), factor);
    hn::StoreU(hn::IfThenElseZero(mask, one), d, out_mask + x);
    hn::StoreU(hn::IfThenElseZero(mask, hn::LoadU(d, ref_row + x)), d, out_ref + x);
    hn::StoreU(hn::IfThenElseZero(mask, value), d, out_other + x);
    hn::StoreU(hn::IfThenElseZero(mask, slope), d, out_slope + x);
  }
}

// Vertical sums of the six window products about row y, into lines 0-5.
template <int R>
void SumProducts(const ZnccWindow& window, int y, int width, Rows& rows) {
  const Tag d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const float *mask[2 * R + 1], *ref[2 * R + 1], *other[2 * R + 1];
  for (int k = 0; k <= 2 * R; ++k) {
    mask[k] = rows.Ring(Rows::kMask, y - R + k);
    ref[k] = rows.Ring(Rows::kRef, y - R + k);
    other[k] = rows.Ring(Rows::kOther, y - R + k);
  }
  float* out[6];
  for (int i = 0; i < 6; ++i) out[i] = rows.Line(i);
  for (int x = 0; x < width; x += lanes) {
    Vec n = hn::Zero(d), s1 = n, s2 = n, s11 = n, s22 = n, s12 = n;
    for (int k = 0; k <= 2 * R; ++k) {
      const Vec w = hn::Set(d, window.taps[k]);
      const Vec i = hn::LoadU(d, ref[k] + x), j = hn::LoadU(d, other[k] + x);
      const Vec wi = hn::Mul(w, i), wj = hn::Mul(w, j);
      n = hn::MulAdd(w, hn::LoadU(d, mask[k] + x), n);
      s1 = hn::Add(s1, wi);
      s2 = hn::Add(s2, wj);
      s11 = hn::MulAdd(wi, i, s11);
      s22 = hn::MulAdd(wj, j, s22);
      s12 = hn::MulAdd(wi, j, s12);
    }
    hn::StoreU(n, d, out[0] + x);
    hn::StoreU(s1, d, out[1] + x);
    hn::StoreU(s2, d, out[2] + x);
    hn::StoreU(s11, d, out[3] + x);
    hn::StoreU(s22, d, out[4] + x);
    hn::StoreU(s12, d, out[5] + x);
  }
}

template <int R>
HWY_INLINE Vec SumAcross(const Tag d, const float* line, const Vec* taps) {
  Vec sum = hn::Mul(taps[0], hn::LoadU(d, line - R));
  for (int k = 1; k <= 2 * R; ++k) sum = hn::MulAdd(taps[k], hn::LoadU(d, line - R + k), sum);
  return sum;
}

// Scores the windows centred on row y from the vertical sums and writes the adjoint's coefficients of the row.
template <int R>
void ScoreRow(const ZnccWindow& window, int y, int width, bool own, Rows& rows, float* count, ZnccSums* sums) {
  const Tag d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const float* line[6];
  for (int i = 0; i < 6; ++i) line[i] = rows.Line(i);
  Vec taps[2 * R + 1];
  for (int k = 0; k <= 2 * R; ++k) taps[k] = hn::Set(d, window.taps[k]);
  const float* mask_row = rows.Ring(Rows::kMask, y);
  float* alpha = rows.Ring(Rows::kAlpha, y);
  float* beta = rows.Ring(Rows::kBeta, y);
  float* gamma = rows.Ring(Rows::kGamma, y);
  float* eta = rows.Ring(Rows::kEta, y);
  const Vec zero = hn::Zero(d), one = hn::Set(d, 1.0f);
  const Vec min_valid = hn::Set(d, window.min_valid), min_variance = hn::Set(d, window.min_variance);
  const Vec epsilon = hn::Set(d, window.epsilon), noise = hn::Set(d, window.noise_variance);
  const Vec max_difference = hn::Set(d, window.max_mean_difference), max_ratio = hn::Set(d, window.max_variance_ratio);
  Vec energy = zero, weight = zero, windows = zero;
  for (int x = 0; x < width; x += lanes) {
    const Vec centre = hn::LoadU(d, mask_row + x);
    auto ok = hn::Ne(centre, zero);
    if (hn::AllFalse(d, ok)) {
      hn::StoreU(zero, d, alpha + x);
      hn::StoreU(zero, d, beta + x);
      hn::StoreU(zero, d, gamma + x);
      hn::StoreU(zero, d, eta + x);
      continue;
    }
    const Vec n = SumAcross<R>(d, line[0] + x, taps);
    ok = hn::And(ok, hn::Ge(n, min_valid));
    const Vec inverse_n = hn::Div(one, hn::IfThenElse(ok, n, one));
    const Vec mu1 = hn::Mul(SumAcross<R>(d, line[1] + x, taps), inverse_n);
    const Vec mu2 = hn::Mul(SumAcross<R>(d, line[2] + x, taps), inverse_n);
    const Vec v1 = hn::NegMulAdd(mu1, mu1, hn::Mul(SumAcross<R>(d, line[3] + x, taps), inverse_n));
    const Vec v2 = hn::NegMulAdd(mu2, mu2, hn::Mul(SumAcross<R>(d, line[4] + x, taps), inverse_n));
    const Vec c = hn::NegMulAdd(mu1, mu2, hn::Mul(SumAcross<R>(d, line[5] + x, taps), inverse_n));
    ok = hn::And(ok, hn::And(hn::Gt(v1, min_variance), hn::Gt(v2, min_variance)));
    ok = hn::And(ok, hn::Lt(hn::Abs(hn::Sub(mu1, mu2)), max_difference));
    ok = hn::And(ok, hn::And(hn::Lt(v1, hn::Mul(v2, max_ratio)), hn::Lt(v2, hn::Mul(v1, max_ratio))));
    const Vec v1e = hn::IfThenElse(ok, hn::Add(v1, epsilon), one);
    const Vec v2e = hn::IfThenElse(ok, hn::Add(v2, epsilon), one);
    const Vec s = hn::Div(one, hn::Sqrt(hn::Mul(v1e, v2e)));
    const Vec zeta = hn::Mul(c, s);
    const Vec r = hn::IfThenElseZero(ok, hn::Div(v1e, hn::Add(v1e, noise)));
    const Vec rn = hn::Mul(r, inverse_n), inverse_v2 = hn::Div(one, v2e), zeta_v2 = hn::Mul(zeta, inverse_v2);
    hn::StoreU(hn::Neg(hn::Mul(rn, s)), d, alpha + x);
    hn::StoreU(hn::Mul(rn, zeta_v2), d, beta + x);
    hn::StoreU(hn::Mul(rn, hn::NegMulAdd(mu2, zeta_v2, hn::Mul(mu1, s))), d, gamma + x);
    hn::StoreU(hn::Mul(rn, inverse_v2), d, eta + x);
    if (own) {
      const Vec accepted = hn::IfThenElseZero(ok, one);
      hn::StoreU(hn::Add(hn::LoadU(d, count + x), accepted), d, count + x);
      energy = hn::MulAdd(r, hn::Sub(one, zeta), energy);
      weight = hn::Add(weight, r);
      windows = hn::Add(windows, accepted);
    }
  }
  if (own) {
    sums->energy += hn::GetLane(hn::SumOfLanes(d, energy));
    sums->weight += hn::GetLane(hn::SumOfLanes(d, weight));
    sums->windows += static_cast<int64_t>(hn::GetLane(hn::SumOfLanes(d, windows)));
  }
}

// Gathers the coefficients of all windows that pixels of row y are in and adds the row's derivatives.
template <int R>
void AdjointRow(const ZnccWindow& window, int y, int width, Rows& rows, float* gradient, float* curvature) {
  const Tag d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  Vec taps[2 * R + 1];
  for (int k = 0; k <= 2 * R; ++k) taps[k] = hn::Set(d, window.taps[k]);
  const Rows::Plane planes[4] = {Rows::kAlpha, Rows::kBeta, Rows::kGamma, Rows::kEta};
  for (int p = 0; p < 4; ++p) {
    const float* ring[2 * R + 1];
    for (int k = 0; k <= 2 * R; ++k) ring[k] = rows.Ring(planes[p], y - R + k);
    float* out = rows.Line(p);
    for (int x = 0; x < width; x += lanes) {
      Vec sum = hn::Mul(taps[0], hn::LoadU(d, ring[0] + x));
      for (int k = 1; k <= 2 * R; ++k) sum = hn::MulAdd(taps[k], hn::LoadU(d, ring[k] + x), sum);
      hn::StoreU(sum, d, out + x);
    }
  }
  const float *alpha = rows.Line(0), *beta = rows.Line(1), *gamma = rows.Line(2), *eta = rows.Line(3);
  const float* ref = rows.Ring(Rows::kRef, y);
  const float* other = rows.Ring(Rows::kOther, y);
  const float* slope_row = rows.Ring(Rows::kSlope, y);
  for (int x = 0; x < width; x += lanes) {
    const Vec slope = hn::LoadU(d, slope_row + x);
    if (hn::AllTrue(d, hn::Eq(slope, hn::Zero(d)))) continue;
    Vec derivative = SumAcross<R>(d, gamma + x, taps);
    derivative = hn::MulAdd(SumAcross<R>(d, alpha + x, taps), hn::LoadU(d, ref + x), derivative);
    derivative = hn::MulAdd(SumAcross<R>(d, beta + x, taps), hn::LoadU(d, other + x), derivative);
    const Vec weight = SumAcross<R>(d, eta + x, taps);
    hn::StoreU(hn::MulAdd(derivative, slope, hn::LoadU(d, gradient + x)), d, gradient + x);
    hn::StoreU(hn::MulAdd(weight, hn::Mul(slope, slope), hn::LoadU(d, curvature + x)), d, curvature + x);
  }
}

template <int R>
ZnccSums RunStrip(const ZnccPair& pair, const ZnccWindow& window, int row_begin, int row_end, PaddedPlane* gradient,
                  PaddedPlane* curvature, PaddedPlane* count, ZnccScratch* scratch) {
  const int width = pair.reference->width, height = pair.reference->height;
  ZnccSums sums;
  Rows rows(width, 2 * R + 1, scratch);
  // One row enters, the row R above it is scored, the row 2R above it is finished.
  for (int y = row_begin - 2 * R; y < row_end + 2 * R; ++y) {
    if (y >= 0 && y < height) {
      WarpRow(pair, y, rows);
    } else {
      for (Rows::Plane plane : {Rows::kMask, Rows::kRef, Rows::kOther, Rows::kSlope}) rows.Clear(plane, y);
    }
    const int scored = y - R;
    if (scored < row_begin - R) continue;
    if (scored >= 0 && scored < height) {
      const bool own = scored >= row_begin && scored < row_end;
      SumProducts<R>(window, scored, width, rows);
      ScoreRow<R>(window, scored, width, own, rows, own ? count->row(scored) : nullptr, &sums);
    } else {
      for (Rows::Plane plane : {Rows::kAlpha, Rows::kBeta, Rows::kGamma, Rows::kEta}) rows.Clear(plane, scored);
    }
    const int finished = y - 2 * R;
    if (finished < row_begin) continue;
    AdjointRow<R>(window, finished, width, rows, gradient->row(finished), curvature->row(finished));
  }
  return sums;
}

ZnccSums Run(const ZnccPair& pair, const ZnccWindow& window, int row_begin, int row_end, PaddedPlane* gradient,
             PaddedPlane* curvature, PaddedPlane* count, ZnccScratch* scratch) {
  switch (window.radius) {
    case 1:
      return RunStrip<1>(pair, window, row_begin, row_end, gradient, curvature, count, scratch);
    case 2:
      return RunStrip<2>(pair, window, row_begin, row_end, gradient, curvature, count, scratch);
    case 3:
      return RunStrip<3>(pair, window, row_begin, row_end, gradient, curvature, count, scratch);
    case 4:
      return RunStrip<4>(pair, window, row_begin, row_end, gradient, curvature, count, scratch);
    default:
      return RunStrip<5>(pair, window, row_begin, row_end, gradient, curvature, count, scratch);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace tessera
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace tessera {
HWY_EXPORT(Run);

ZnccSums AccumulateZncc(const ZnccPair& pair, const ZnccWindow& window, int row_begin, int row_end,
                        PaddedPlane* gradient, PaddedPlane* curvature, PaddedPlane* count, ZnccScratch* scratch) {
  return HWY_DYNAMIC_DISPATCH(Run)(pair, window, row_begin, row_end, gradient, curvature, count, scratch);
}

}  // namespace tessera
#endif  // HWY_ONCE
