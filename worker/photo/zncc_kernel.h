// The kernel of the data term: warps one strip of an ordered image pair, and computes score and derivatives of
// luminance and classes in one pass.
#pragma once

#include <cstdint>

#include "worker/photo/reference_strip.h"
#include "worker/photo/texels.h"
#include "worker/photo/warp_target.h"

namespace tessera {

// Parameters of the windowed score, as programs use them. Intensities in [0, 1].
struct ZnccWindow {
  static constexpr int kMaxRadius = 5;
  int radius = 3;                       // windows have 2·radius + 1 pixels per side; 1..kMaxRadius
  float taps[2 * kMaxRadius + 1] = {};  // one-dimensional weights, sum 1 (MakeWindow)
  float min_valid = 0.5f;               // share of the window's weight that must be visible in both images
  float min_variance = 0.004 * 0.004;   // in either image
  float max_mean_difference = 0.3f;     // |μ1 - μ2|
  float max_variance_ratio = 10;        // ratio of the larger variance to the smaller
  float epsilon = 1e-6f;                // added to both variances
  float noise_variance = 0.01 * 0.01;   // r = v1 / (v1 + noise_variance)
  float outlier = 0.5f;                 // s: a window's e = 1 - ζ counts e / (1 + e/s)
};

// An ordered pair at one pyramid level. A reference pixel centre x̃ = (x + ½, y + ½, 1) at depth z is warped to q =
// z·M x̃ + t, (u, v) = (q0, q1)/q2 in the other image.
struct ZnccPair {
  const Texels* reference = nullptr;
  const WarpTarget* other = nullptr;
  float m[9] = {};  // M, row-major
  float t[3] = {};
  float depth_slack = 0;  // occluded if q2 > nearest depth there · (1 + depth_slack)
};

struct ZnccSums {
  double energy = 0;           // Σ r ρ(1 - ζ) over accepted windows
  double weight = 0;           // Σ r
  int64_t windows = 0;         // accepted windows
  double semantic_energy = 0;  // Σ ½ Σ_l ΔL² over visible pixels, without the term's weight
  int64_t semantic_pixels = 0;

  void Add(const ZnccSums& other);
};

// Buffers of the functions below, one per thread, reused between calls.
struct ZnccScratch {
  LineVector<float> data;
  LineVector<uint8_t> flags;
};

// Computes inverse_weight, mean and variance of a strip from its depth_factor.
void SummarizeReference(const Texels& reference, const ZnccWindow& window, ReferenceStrip* strip, ZnccScratch* scratch);

// Adds the pair's derivatives for every pixel of the strip's rows.
// `gradient`: ∂E/∂(plane offset of the face along its normal) = ∂₂h · [∇I_j · DΠ_j r] z/h, with the exact derivative
// of all windows that contain the pixel, plus `semantic_weight` times that of E_sem, ½ Σ_l (L_i^l - L_ij^l)² per pixel.
// `curvature`: Gauss-Newton second derivative. `count`: 1 if the window around the pixel was accepted (with E_sem: if
// the pixel is visible). Returned energies are those of windows centred in the rows. Windows that extend into other
// rows are computed in full, so the strips add up exactly to the whole image. E_sem is skipped if its weight is 0, and
// unless both views have likelihoods of equally many classes. The instruction set is chosen at run time. AVX2 and
// AVX-512 agree in every bit; without fused multiply-add (SSE4 and below) results differ by rounding.
ZnccSums AccumulateZncc(const ZnccPair& pair, const ZnccWindow& window, float semantic_weight, ReferenceStrip* strip,
                        ZnccScratch* scratch);

}  // namespace tessera
