// The inner loop of the photo term: one strip of one ordered image pair, warped, scored and differentiated.
#ifndef TESSERA_WORKER_REFINE_ZNCC_KERNEL_H_
#define TESSERA_WORKER_REFINE_ZNCC_KERNEL_H_

#include <cstddef>
#include <cstdint>
#include <vector>

namespace tessera {

// Float pixels whose rows are padded, so that vectors may read (never write) a little past a row's end.
struct PaddedPlane {
  static constexpr int kPadding = 16;
  int width = 0, height = 0, stride = 0;
  std::vector<float> data;

  void Reset(int w, int h, float value = 0) {
    width = w;
    height = h;
    stride = (w + kPadding - 1) / kPadding * kPadding + kPadding;
    data.assign(static_cast<size_t>(stride) * h + kPadding, value);
  }
  float* row(int y) { return data.data() + static_cast<size_t>(stride) * y; }
  const float* row(int y) const { return data.data() + static_cast<size_t>(stride) * y; }
};

// What the score needs to know about windows. Intensities in [0, 1].
struct ZnccWindow {
  static constexpr int kMaxRadius = 5;
  int radius = 3;                       // the window has 2·radius + 1 pixels a side; 1..kMaxRadius
  float taps[2 * kMaxRadius + 1] = {};  // one-dimensional weights, sum 1
  float min_valid = 0.5f;               // share of the window's weight that must be valid
  float min_variance = 0;               // in either image
  float max_mean_difference = 1;        // |μ1 - μ2|
  float max_variance_ratio = 1e30f;     // of the greater variance to the smaller
  float epsilon = 0;                    // added to both variances
  float noise_variance = 0;             // r = v1 / (v1 + noise_variance)
};

// An ordered pair at one pyramid level. A reference pixel centre x̃ = (x + ½, y + ½, 1) at depth z lands in the other
// image at q = z·M x̃ + t, (u, v) = (q0, q1)/q2.
struct ZnccPair {
  const PaddedPlane* reference = nullptr;     // luminance
  const PaddedPlane* depth = nullptr;         // z of the face a reference pixel sees
  const PaddedPlane* depth_factor = nullptr;  // z/h of that face (h = n·(V0 - C)); 0 where the pixel is not used
  const PaddedPlane* other = nullptr;         // luminance, NaN where invalid
  const float* other_depth = nullptr;         // depth of the nearest surface in the other view, rows of other->width
  float m[9] = {};                            // M, row-major
  float t[3] = {};
  float depth_slack = 0;  // hidden where q2 > other depth · (1 + depth_slack)
};

struct ZnccSums {
  double energy = 0;    // Σ r (1 - ζ) over accepted windows
  double weight = 0;    // Σ r
  int64_t windows = 0;  // accepted windows
};

// Buffers of AccumulateZncc, reused from call to call; one a thread.
struct ZnccScratch {
  std::vector<float> data;
};

// For every reference pixel in rows [row_begin, row_end): adds to `gradient` ∂E/∂(plane offset of the face along its
// normal) = ∂₂h · [∇I_j · DΠ_j r] z/h, with the exact derivative of all windows the pixel is in; to `curvature` the
// Gauss-Newton second derivative; to `count` 1 where the window about the pixel was accepted. Energies are those of
// windows centred in the rows. Planes have the reference's size. Windows that reach into other rows are computed from
// them, so strips add up to the whole exactly. Concurrent calls must not share scratch or rows of the output planes.
// Instructions are chosen at run time, AVX2 at most, so that machines agree to the bit.
ZnccSums AccumulateZncc(const ZnccPair& pair, const ZnccWindow& window, int row_begin, int row_end,
                        PaddedPlane* gradient, PaddedPlane* curvature, PaddedPlane* count, ZnccScratch* scratch);

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_ZNCC_KERNEL_H_
