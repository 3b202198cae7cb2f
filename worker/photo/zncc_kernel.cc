#include "worker/photo/zncc_kernel.h"

#include <algorithm>
#include <type_traits>

// SSSE3 alone is not worth its code: such machines take the baseline.
#define HWY_DISABLED_TARGETS HWY_SSSE3
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "worker/photo/zncc_kernel.cc"
#include <hwy/foreach_target.h>
//
#include <hwy/highway.h>

#include "worker/photo/zncc_warp-inl.h"

HWY_BEFORE_NAMESPACE();
namespace tessera {
namespace HWY_NAMESPACE {

// Lines for a slab's column sums: plane p of row r is line 6·r + p.
enum SumLine { kS2, kS22, kS12, kN, kS1, kS11 };
constexpr int kSumLines = 6;

struct LinesOfRow {
  const float* at[kSumLines];
  LinesOfRow(int r, Rows& rows) {
    for (int p = 0; p < kSumLines; ++p) at[p] = rows.Line(kSumLines * r + p);
  }
};

// The window's weights, broadcast to vectors.
template <int R>
struct Taps {
  Vec tap[2 * R + 1];
  explicit Taps(const ZnccWindow& window) {
    for (int k = 0; k <= 2 * R; ++k) tap[k] = hn::Set(Tag(), window.taps[k]);
  }
};

// Adds `value` of row k of a slab to the sums of those window rows that contain it.
template <int R>
HWY_INLINE void AddRow(const Taps<R>& taps, int k, Vec value, Vec* sums) {
#pragma GCC unroll 4
  for (int r = 0; r < kSlab; ++r) {
    if (k >= r && k - r <= 2 * R) sums[r] = hn::MulAdd(taps.tap[k - r], value, sums[r]);
  }
}

// Column sums for the windows centred on rows y .. y + kSlab - 1, columns [begin, end). Windows are separable:
// columns are summed first, then rows. The rows of a slab share the loads of their common window rows, since the
// kernel is bound by memory access.
template <int R>
struct ColumnSums {
  static constexpr int kRows = kSlab + 2 * R;
  const float* mask[kRows];
  size_t plane;
  Rows& rows;

  ColumnSums(int y, Rows& all_rows) : plane(all_rows.plane_size()), rows(all_rows) {
    for (int k = 0; k < kRows; ++k) mask[k] = rows.Ring(Rows::kMask, y - R + k);
  }

  // Sums of the other image and of the products.
  void AddOther(const Taps<R>& taps, int begin, int end) const {
    const Tag d;
    for (int x = begin; x < end; x += static_cast<int>(hn::Lanes(d))) {
      Vec s2[kSlab], s22[kSlab], s12[kSlab];
#pragma GCC unroll 4
      for (int r = 0; r < kSlab; ++r) s2[r] = s22[r] = s12[r] = hn::Zero(d);
#pragma GCC unroll 16
      for (int k = 0; k < kRows; ++k) {
        const float* at = mask[k] + x;
        const Vec i = hn::LoadU(d, at + plane * Rows::kRef), j = hn::LoadU(d, at + plane * Rows::kOther);
        AddRow<R>(taps, k, j, s2);
        AddRow<R>(taps, k, hn::Mul(j, j), s22);
        AddRow<R>(taps, k, hn::Mul(i, j), s12);
      }
#pragma GCC unroll 4
      for (int r = 0; r < kSlab; ++r) {
        hn::StoreU(s2[r], d, rows.Line(kSumLines * r + kS2) + x);
        hn::StoreU(s22[r], d, rows.Line(kSumLines * r + kS22) + x);
        hn::StoreU(s12[r], d, rows.Line(kSumLines * r + kS12) + x);
      }
    }
  }

  // Sums of the mask and the reference only.
  void AddReference(const Taps<R>& taps, int begin, int end) const {
    const Tag d;
    for (int x = begin; x < end; x += static_cast<int>(hn::Lanes(d))) {
      Vec n[kSlab], s1[kSlab], s11[kSlab];
#pragma GCC unroll 4
      for (int r = 0; r < kSlab; ++r) n[r] = s1[r] = s11[r] = hn::Zero(d);
#pragma GCC unroll 16
      for (int k = 0; k < kRows; ++k) {
        const float* at = mask[k] + x;
        const Vec i = hn::LoadU(d, at + plane * Rows::kRef);
        AddRow<R>(taps, k, hn::LoadU(d, at), n);
        AddRow<R>(taps, k, i, s1);
        AddRow<R>(taps, k, hn::Mul(i, i), s11);
      }
#pragma GCC unroll 4
      for (int r = 0; r < kSlab; ++r) {
        hn::StoreU(n[r], d, rows.Line(kSumLines * r + kN) + x);
        hn::StoreU(s1[r], d, rows.Line(kSumLines * r + kS1) + x);
        hn::StoreU(s11[r], d, rows.Line(kSumLines * r + kS11) + x);
      }
    }
  }
};

template <int R>
HWY_INLINE Vec SumAcross(const Taps<R>& taps, const float* line) {
  const Tag d;
  Vec sum = hn::Mul(taps.tap[0], hn::LoadU(d, line - R));
#pragma GCC unroll 16
  for (int k = 1; k <= 2 * R; ++k) sum = hn::MulAdd(taps.tap[k], hn::LoadU(d, line - R + k), sum);
  return sum;
}

// The reference's part of a window's statistics. Computed with the same operations for a pair and for the reference
// alone, so that both give the same bits where all used pixels are visible in the other view.
struct ReferenceWindow {
  Vec inverse_n, mu1, v1;  // inverse_n is 0 if too little of the window is valid
};

template <int R>
HWY_INLINE ReferenceWindow MakeReferenceWindow(const Taps<R>& taps, const LinesOfRow& line, int x, Vec centre,
                                               Vec min_valid) {
  const Tag d;
  const Vec zero = hn::Zero(d), one = hn::Set(d, 1.0f);
  const Vec n = SumAcross<R>(taps, line.at[kN] + x);
  const auto ok = hn::And(hn::Ne(centre, zero), hn::Ge(n, min_valid));
  ReferenceWindow w;
  w.inverse_n = hn::IfThenElseZero(ok, hn::Div(one, hn::IfThenElse(ok, n, one)));
  w.mu1 = hn::Mul(SumAcross<R>(taps, line.at[kS1] + x), w.inverse_n);
  w.v1 = hn::NegMulAdd(w.mu1, w.mu1, hn::Mul(SumAcross<R>(taps, line.at[kS11] + x), w.inverse_n));
  return w;
}

struct RowTotals {
  LaneSums energy, weight, windows;
};

// Scores the windows centred on columns [begin, end) of row y from the column sums. Writes the coefficients of the
// adjoint: the derivative of a window's energy by the warped intensity I_j of one of its pixels is (alpha I_i + beta
// I_j + gamma) times the pixel's weight, so four numbers per window (eta: curvature) replace a derivative per window
// and pixel. With kAlone the reference's part is read from the strip, because all used pixels are visible.
template <int R, bool kAlone>
void ScoreColumns(const ZnccWindow& window, const Taps<R>& taps, const LinesOfRow& line, int y, int begin, int end,
                  bool semantic, Rows& rows, ReferenceStrip* strip, RowTotals* totals) {
  const Tag d;
  const float* mask_row = rows.Ring(Rows::kMask, y);
  float* alpha = rows.Ring(Rows::kAlpha, y);
  float* beta = rows.Ring(Rows::kBeta, y);
  float* gamma = rows.Ring(Rows::kGamma, y);
  float* eta = rows.Ring(Rows::kEta, y);
  const Vec zero = hn::Zero(d), one = hn::Set(d, 1.0f);
  const Vec min_valid = hn::Set(d, window.min_valid), min_variance = hn::Set(d, window.min_variance);
  const Vec epsilon = hn::Set(d, window.epsilon), noise = hn::Set(d, window.noise_variance);
  const Vec max_difference = hn::Set(d, window.max_mean_difference), max_ratio = hn::Set(d, window.max_variance_ratio);
  const Vec inverse_outlier = hn::Set(d, 1 / window.outlier);
  for (int x = begin; x < end; x += static_cast<int>(hn::Lanes(d))) {
    const Vec centre = hn::LoadU(d, mask_row + x);
    ReferenceWindow w;
    if (kAlone) {
      w.inverse_n = hn::LoadU(d, strip->inverse_weight.row(y) + x);
      w.mu1 = hn::LoadU(d, strip->mean.row(y) + x);
      w.v1 = hn::LoadU(d, strip->variance.row(y) + x);
    } else {
      w = MakeReferenceWindow<R>(taps, line, x, centre, min_valid);
    }
    const Vec mu2 = hn::Mul(SumAcross<R>(taps, line.at[kS2] + x), w.inverse_n);
    const Vec v2 = hn::NegMulAdd(mu2, mu2, hn::Mul(SumAcross<R>(taps, line.at[kS22] + x), w.inverse_n));
    const Vec c = hn::NegMulAdd(w.mu1, mu2, hn::Mul(SumAcross<R>(taps, line.at[kS12] + x), w.inverse_n));
    auto ok = hn::And(hn::Gt(w.inverse_n, zero), hn::And(hn::Gt(w.v1, min_variance), hn::Gt(v2, min_variance)));
    ok = hn::And(ok, hn::Lt(hn::Abs(hn::Sub(w.mu1, mu2)), max_difference));
    ok = hn::And(ok, hn::And(hn::Lt(w.v1, hn::Mul(v2, max_ratio)), hn::Lt(v2, hn::Mul(w.v1, max_ratio))));
    const Vec v1 = hn::IfThenElse(ok, hn::Add(w.v1, epsilon), one);
    const Vec v2e = hn::IfThenElse(ok, hn::Add(v2, epsilon), one);
    // s = 1/√(v1 v2), 1/v2 and r = v1/(v1 + noise) from one division.
    const Vec root = hn::Sqrt(hn::Mul(v1, v2e)), noisy = hn::Add(v1, noise);
    const Vec a = hn::Mul(v2e, noisy), inverse = hn::Div(one, hn::Mul(root, a));
    const Vec s = hn::Mul(a, inverse), inverse_v2 = hn::Mul(hn::Mul(root, noisy), inverse);
    const Vec r = hn::IfThenElseZero(ok, hn::Mul(hn::Mul(v1, root), hn::Mul(v2e, inverse)));
    const Vec zeta = hn::Mul(c, s);
    const Vec outlying = hn::Sub(one, zeta), share = hn::Div(one, hn::MulAdd(outlying, inverse_outlier, one));
    const Vec e = hn::Mul(outlying, share), rn = hn::Mul(hn::Mul(r, w.inverse_n), hn::Mul(share, share));
    const Vec rs = hn::Mul(rn, s), rv = hn::Mul(rn, inverse_v2), rb = hn::Mul(rv, zeta);
    hn::StoreU(hn::Neg(rs), d, alpha + x);
    hn::StoreU(rb, d, beta + x);
    hn::StoreU(hn::NegMulAdd(mu2, rb, hn::Mul(w.mu1, rs)), d, gamma + x);
    hn::StoreU(rv, d, eta + x);
    if (totals == nullptr) continue;
    const Vec accepted = hn::IfThenElseZero(ok, one);
    if (!semantic) {
      float* count = strip->count.row(y) + x;
      hn::StoreU(hn::Add(hn::LoadU(d, count), accepted), d, count);
    }
    totals->energy.Add(d, x, hn::Mul(r, e));
    totals->weight.Add(d, x, r);
    totals->windows.Add(d, x, accepted);
  }
}

// Or of the flags of a block and its neighbours. The arrays have a zero at both ends.
HWY_INLINE int Around(const uint8_t* flags, int b) { return flags[b - 1] | flags[b] | flags[b + 1]; }

// Calls body(flags, begin, end) for the columns of each run of blocks [first, last) with equal flags.
template <class Body>
HWY_INLINE void ForRuns(const uint8_t* flags, int first, int last, const Body& body) {
  for (int b = first; b < last;) {
    const int begin = b;
    while (b < last && flags[b] == flags[begin]) ++b;
    body(flags[begin], begin * kPixelBlock, b * kPixelBlock);
  }
}

// A window extends into at most one block on either side.
static_assert(ZnccWindow::kMaxRadius <= kPixelBlock);

// Sums and scores the windows centred on rows y .. y + kSlab - 1.
template <int R>
void ScoreSlab(const ZnccPair& pair, const ZnccWindow& window, const Taps<R>& taps, bool semantic, int y, Rows& rows,
               ReferenceStrip* strip, ZnccSums* sums) {
  const int blocks = rows.blocks(), height = pair.reference->height;
  uint8_t* state = rows.State();
  uint8_t* sum_state = rows.SumState();
  std::fill_n(sum_state, blocks, uint8_t{0});
  for (int k = 0; k < kSlab + 2 * R; ++k) {
    const uint8_t* flags = rows.PixelFlags(y - R + k);
    for (int b = 0; b < blocks; ++b) sum_state[b] |= flags[b];
  }
  for (int b = 0; b < blocks; ++b) {
    state[b] = sum_state[b] & Rows::kSeen ? static_cast<uint8_t>(Around(sum_state, b)) : uint8_t{0};
  }
  for (int b = 0; b < blocks; ++b) sum_state[b] = static_cast<uint8_t>(Around(state, b));
  const ColumnSums<R> columns(y, rows);
  RowTotals totals[kSlab];
  rows.InChunks(
      [&](int first, int last) {
        ForRuns(sum_state, first, last, [&](int flags, int begin, int end) {
          if (flags & Rows::kSeen) columns.AddOther(taps, begin, end);
          if (flags & Rows::kLost) columns.AddReference(taps, begin, end);
        });
      },
      [&](int first, int last) {
        for (int r = 0; r < kSlab; ++r) {
          const int row = y + r;
          if (row < 0 || row >= height || row < strip->row_begin - R || row >= strip->row_end + R) continue;
          const bool own = row >= strip->row_begin && row < strip->row_end;
          const LinesOfRow line(r, rows);
          uint8_t* flags = rows.WindowFlags(row);
          for (int b = first; b < last; ++b) flags[b] = state[b] ? Rows::kScored : 0;
          RowTotals* sums_of_row = own ? &totals[r] : nullptr;
          ForRuns(state, first, last, [&](int found, int begin, int end) {
            if (found & Rows::kLost) {
              ScoreColumns<R, false>(window, taps, line, row, begin, end, semantic, rows, strip, sums_of_row);
            } else if (found) {
              ScoreColumns<R, true>(window, taps, line, row, begin, end, semantic, rows, strip, sums_of_row);
            } else {
              for (Rows::Plane plane : {Rows::kAlpha, Rows::kBeta, Rows::kGamma, Rows::kEta}) {
                std::fill_n(rows.Ring(plane, row) + begin, end - begin, 0.0f);
              }
            }
          });
        }
      });
  for (int r = 0; r < kSlab; ++r) {
    if (y + r < 0 || y + r >= height) rows.ClearWindows(y + r);
    sums->energy += totals[r].energy.Total();
    sums->weight += totals[r].weight.Total();
    sums->windows += static_cast<int64_t>(totals[r].windows.Total());
  }
}

// Adjoint pass: sums the coefficients of all windows that contain a pixel of rows y .. y + kSlab - 1, with the same
// separable weights, and adds the derivatives. So the exact gradient costs about as much as the score.
template <int R>
void AdjointSlab(const Taps<R>& taps, int y, Rows& rows, ReferenceStrip* strip) {
  const Tag d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const int blocks = rows.blocks();
  uint8_t* state = rows.State();
  uint8_t* sum_state = rows.SumState();
  std::fill_n(sum_state, blocks, uint8_t{0});
  std::fill_n(state, blocks, uint8_t{0});
  const float* ring[kSlab + 2 * R];
  for (int k = 0; k < kSlab + 2 * R; ++k) {
    const uint8_t* flags = rows.WindowFlags(y - R + k);
    for (int b = 0; b < blocks; ++b) sum_state[b] |= flags[b];
    ring[k] = rows.Ring(Rows::kAlpha, y - R + k);
  }
  for (int r = 0; r < kSlab; ++r) {
    const uint8_t* flags = rows.PixelFlags(y + r);
    for (int b = 0; b < blocks; ++b) state[b] |= flags[b] & Rows::kSeen;
  }
  for (int b = 0; b < blocks; ++b) {
    if (Around(sum_state, b) == 0) state[b] = 0;
  }
  for (int b = 0; b < blocks; ++b) sum_state[b] = static_cast<uint8_t>(Around(state, b));
  const auto sum_down = [&](int first, int last) {
    for (int b = first; b < last; ++b) {
      if (sum_state[b] == 0) continue;
      for (int p = 0; p < 4; ++p) {
        const size_t plane = rows.plane_size() * p;
        for (int x = b * kPixelBlock; x < (b + 1) * kPixelBlock; x += lanes) {
          Vec sum[kSlab];
#pragma GCC unroll 4
          for (int r = 0; r < kSlab; ++r) sum[r] = hn::Zero(d);
#pragma GCC unroll 16
          for (int k = 0; k < kSlab + 2 * R; ++k) AddRow<R>(taps, k, hn::LoadU(d, ring[k] + plane + x), sum);
#pragma GCC unroll 4
          for (int r = 0; r < kSlab; ++r) hn::StoreU(sum[r], d, rows.Line(4 * r + p) + x);
        }
      }
    }
  };
  const auto sum_across = [&](int first, int last) {
    for (int r = 0; r < kSlab; ++r) {
      const int row = y + r;
      if (row < strip->row_begin || row >= strip->row_end) continue;
      const float *alpha = rows.Line(4 * r), *beta = rows.Line(4 * r + 1), *gamma = rows.Line(4 * r + 2),
                  *eta = rows.Line(4 * r + 3);
      const float* ref = rows.Ring(Rows::kRef, row);
      const float* other = rows.Ring(Rows::kOther, row);
      const float* slope_row = rows.Ring(Rows::kSlope, row);
      float* gradient = strip->gradient.row(row);
      float* curvature = strip->curvature.row(row);
      for (int b = first; b < last; ++b) {
        if (state[b] == 0) continue;
        for (int x = b * kPixelBlock; x < (b + 1) * kPixelBlock; x += lanes) {
          const Vec slope = hn::LoadU(d, slope_row + x);
          Vec derivative = SumAcross<R>(taps, gamma + x);
          derivative = hn::MulAdd(SumAcross<R>(taps, alpha + x), hn::LoadU(d, ref + x), derivative);
          derivative = hn::MulAdd(SumAcross<R>(taps, beta + x), hn::LoadU(d, other + x), derivative);
          const Vec weight = SumAcross<R>(taps, eta + x);
          hn::StoreU(hn::MulAdd(derivative, slope, hn::LoadU(d, gradient + x)), d, gradient + x);
          hn::StoreU(hn::MulAdd(weight, hn::Mul(slope, slope), hn::LoadU(d, curvature + x)), d, curvature + x);
        }
      }
    }
  };
  rows.InChunks(sum_down, sum_across);
}

// Pipeline: as a slab of rows is warped, the windows R rows above it become complete and are scored, and the pixels
// 2R rows above it get their derivatives. All intermediate rows stay in the cache.
template <int R, bool kSemantic>
ZnccSums RunStrip(const ZnccPair& pair, const ZnccWindow& window, float semantic_weight, ReferenceStrip* strip,
                  ZnccScratch* scratch) {
  const Taps<R> taps(window);
  Rows rows(pair.reference->width, R, scratch);
  ZnccSums sums;
  for (int y = strip->row_begin - 2 * R; y < strip->row_end + 2 * R; y += kSlab) {
    for (int row = y; row < y + kSlab; ++row) {
      if (row < 0 || row >= pair.reference->height || row >= strip->row_end + 2 * R) {
        rows.ClearPixels(row);
      } else if (kSemantic && row >= strip->row_begin && row < strip->row_end) {
        WarpRow<true>(pair, semantic_weight, row, rows, strip, &sums);
      } else {
        WarpRow<false>(pair, semantic_weight, row, rows, strip, &sums);
      }
    }
    if (y - R + kSlab > strip->row_begin - R) {
      ScoreSlab<R>(pair, window, taps, kSemantic, y - R, rows, strip, &sums);
    }
    if (y - 2 * R + kSlab > strip->row_begin) AdjointSlab<R>(taps, y - 2 * R, rows, strip);
  }
  return sums;
}

template <int R>
void SummarizeStrip(const Texels& reference, const ZnccWindow& window, ReferenceStrip* strip, ZnccScratch* scratch) {
  const Tag d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const Taps<R> taps(window);
  const Vec min_valid = hn::Set(d, window.min_valid), one = hn::Set(d, 1.0f), zero = hn::Zero(d);
  const Vec scale = hn::Set(d, kLuminanceScale), shift = hn::Set(d, kLuminanceShift);
  Rows rows(reference.width, R, scratch);
  const int end_x = rows.blocks() * kPixelBlock;
  for (int y = strip->row_begin - 2 * R; y < strip->row_end + 2 * R; y += kSlab) {
    for (int row = y; row < y + kSlab; ++row) {
      if (row < 0 || row >= reference.height || row >= strip->row_end + 2 * R) {
        rows.ClearPixels(row);
        continue;
      }
      const uint16_t* luminance = reference.luminance.data() + reference.Index(0, row);
      for (int x = 0; x < end_x; x += lanes) {
        const auto used = hn::Ne(hn::LoadU(d, strip->depth_factor.row(row) + x), zero);
        const Vec ref = hn::MulAdd(LoadLuminance(d, luminance + x), scale, shift);
        hn::StoreU(hn::IfThenElseZero(used, one), d, rows.Ring(Rows::kMask, row) + x);
        hn::StoreU(hn::IfThenElseZero(used, ref), d, rows.Ring(Rows::kRef, row) + x);
      }
    }
    const ColumnSums<R> columns(y - R, rows);
    const auto sum_across = [&](int first, int last) {
      for (int r = 0; r < kSlab; ++r) {
        const int row = y - R + r;
        if (row < strip->mean.first_row || row >= strip->mean.first_row + strip->mean.rows) continue;
        const LinesOfRow line(r, rows);
        for (int x = first * kPixelBlock; x < last * kPixelBlock; x += lanes) {
          const Vec centre = hn::LoadU(d, rows.Ring(Rows::kMask, row) + x);
          const ReferenceWindow w = MakeReferenceWindow<R>(taps, line, x, centre, min_valid);
          hn::StoreU(w.inverse_n, d, strip->inverse_weight.row(row) + x);
          hn::StoreU(w.mu1, d, strip->mean.row(row) + x);
          hn::StoreU(w.v1, d, strip->variance.row(row) + x);
        }
      }
    };
    rows.InChunks([&](int first, int last) { columns.AddReference(taps, first * kPixelBlock, last * kPixelBlock); },
                  sum_across);
  }
}

// Calls body with the radius as a constant.
template <class Body>
auto WithRadius(int radius, const Body& body) {
  switch (radius) {
    case 1:
      return body(std::integral_constant<int, 1>());
    case 2:
      return body(std::integral_constant<int, 2>());
    case 3:
      return body(std::integral_constant<int, 3>());
    case 4:
      return body(std::integral_constant<int, 4>());
    default:
      return body(std::integral_constant<int, 5>());
  }
}

ZnccSums Run(const ZnccPair& pair, const ZnccWindow& window, float semantic_weight, ReferenceStrip* strip,
             ZnccScratch* scratch) {
  const bool classes =
      semantic_weight > 0 && pair.reference->classes > 0 && pair.reference->classes == pair.other->texels->classes;
  return WithRadius(window.radius, [&](auto radius) {
    return classes ? RunStrip<radius, true>(pair, window, semantic_weight, strip, scratch)
                   : RunStrip<radius, false>(pair, window, semantic_weight, strip, scratch);
  });
}

void Summarize(const Texels& reference, const ZnccWindow& window, ReferenceStrip* strip, ZnccScratch* scratch) {
  WithRadius(window.radius, [&](auto radius) { SummarizeStrip<radius>(reference, window, strip, scratch); });
}

}  // namespace HWY_NAMESPACE
}  // namespace tessera
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace tessera {
HWY_EXPORT(Run);
HWY_EXPORT(Summarize);

void ZnccSums::Add(const ZnccSums& other) {
  energy += other.energy;
  weight += other.weight;
  windows += other.windows;
  semantic_energy += other.semantic_energy;
  semantic_pixels += other.semantic_pixels;
}

void SummarizeReference(const Texels& reference, const ZnccWindow& window, ReferenceStrip* strip,
                        ZnccScratch* scratch) {
  HWY_DYNAMIC_DISPATCH(Summarize)(reference, window, strip, scratch);
}

ZnccSums AccumulateZncc(const ZnccPair& pair, const ZnccWindow& window, float semantic_weight, ReferenceStrip* strip,
                        ZnccScratch* scratch) {
  return HWY_DYNAMIC_DISPATCH(Run)(pair, window, semantic_weight, strip, scratch);
}

}  // namespace tessera
#endif  // HWY_ONCE
