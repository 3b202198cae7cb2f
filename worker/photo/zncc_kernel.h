// The inner loop of the data term: one strip of one ordered image pair, warped, scored and differentiated, image and
// classes in one pass.
#ifndef TESSERA_WORKER_PHOTO_ZNCC_KERNEL_H_
#define TESSERA_WORKER_PHOTO_ZNCC_KERNEL_H_

#include <cstdint>
#include <limits>

#include "worker/photo/reference_strip.h"
#include "worker/photo/texels.h"
#include "worker/photo/warp_target.h"

namespace tessera {

// What the score needs to know about windows. Intensities in [0, 1].
struct ZnccWindow {
  static constexpr int kMaxRadius = 5;
  int radius = 3;                                          // the window has 2·radius + 1 pixels a side; 1..kMaxRadius
  float taps[2 * kMaxRadius + 1] = {};                     // one-dimensional weights, sum 1
  float min_valid = 0.5f;                                  // share of the window's weight that must be valid
  float min_variance = 0;                                  // in either image
  float max_mean_difference = 1;                           // |μ1 - μ2|
  float max_variance_ratio = 1e30f;                        // of the greater variance to the smaller
  float epsilon = 0;                                       // added to both variances
  float noise_variance = 0;                                // r = v1 / (v1 + noise_variance)
  float outlier = std::numeric_limits<float>::infinity();  // s: a window's e = 1 - ζ counts e / (1 + e/s)
};

// E_sem: a pixel's e = ½ Σ_l (L_i^l - L_ij^l)² counts e / (1 + e / outlier).
struct SemanticWeight {
  float weight = 0;  // of E_sem beside E_photo; 0: off
  float outlier = std::numeric_limits<float>::infinity();
};

// An ordered pair at one pyramid level. A reference pixel centre x̃ = (x + ½, y + ½, 1) at depth z lands in the other
// image at q = z·M x̃ + t, (u, v) = (q0, q1)/q2.
struct ZnccPair {
  const Texels* reference = nullptr;
  const WarpTarget* other = nullptr;
  float m[9] = {};  // M, row-major
  float t[3] = {};
  float depth_slack = 0;  // hidden where q2 > depth of the nearest surface there · (1 + depth_slack)
};

struct ZnccSums {
  double energy = 0;           // Σ r ρ(1 - ζ) over accepted windows
  double weight = 0;           // Σ r
  int64_t windows = 0;         // accepted windows
  double semantic_energy = 0;  // Σ ρ(½ Σ_l ΔL²) over seen pixels, without the term's weight
  int64_t semantic_pixels = 0;

  void Add(const ZnccSums& other);
};

// Buffers of the functions below, reused from call to call; one a thread.
struct ZnccScratch {
  LineVector<float> data;
  LineVector<uint8_t> flags;
};

// Fills inverse_weight, mean and variance of a strip from its depth_factor.
void SummarizeReference(const Texels& reference, const ZnccWindow& window, ReferenceStrip* strip, ZnccScratch* scratch);

// For every pixel of the strip's rows: adds to `gradient` ∂E/∂(plane offset of the face along its normal) =
// ∂₂h · [∇I_j · DΠ_j r] z/h, with the exact derivative of all windows the pixel is in, and of E_sem times its weight;
// to `curvature` the Gauss-Newton second derivative; to `count` 1 where the window about the pixel was accepted (with
// E_sem: where the pixel is seen at all). Energies are those of windows centred in the rows. Windows that reach into
// other rows are computed from them, so strips add up to the whole exactly. E_sem is left out unless both views have
// likelihoods, as many classes each.
// Instructions are chosen at run time. AVX2 and AVX-512 agree to the bit in all they write and return; without fused
// multiply-add (SSE4 and less) results differ by rounding.
ZnccSums AccumulateZncc(const ZnccPair& pair, const ZnccWindow& window, const SemanticWeight& semantic,
                        ReferenceStrip* strip, ZnccScratch* scratch);

}  // namespace tessera

#endif  // TESSERA_WORKER_PHOTO_ZNCC_KERNEL_H_
