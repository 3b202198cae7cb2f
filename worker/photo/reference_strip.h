// The reference side of the data term: rows of one view, with what all its pairs have in common.
#pragma once

#include "common/imaging/camera.h"
#include "worker/photo/texels.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// Rows [row_begin, row_end) of a reference image. Reused from strip to strip.
struct ReferenceStrip {
  int row_begin = 0, row_end = 0;
  // Set by FillStrip for these rows and up to 2·radius more on either side. `depth`: z of the visible face.
  // `depth_factor`: z/h with h = n·(V0 - C). Both 0 in unused pixels and padding.
  PaddedPlane depth, depth_factor;
  // Set by SummarizeReference for radius more rows on either side: 1/weight (0: too few used pixels), mean and
  // variance of the window around a pixel over the reference's used pixels.
  PaddedPlane inverse_weight, mean, variance;
  // Output of AccumulateZncc, for the rows [row_begin, row_end) only.
  PaddedPlane gradient, curvature, count;

  // Resizes the planes and clears those that are accumulated into.
  void Reset(int width, int height, int radius, int new_row_begin, int new_row_end);
};

// Minimum cosine between a face's normal and the ray.
inline constexpr float kMinRayCosine = 0.1f;

// Fills depth and depth_factor. `offset`: h of every face relative to the view's centre, metres. Pixels without
// luminance, and those whose ray meets the face from behind or at a cosine below kMinRayCosine, are not used.
void FillStrip(const PinholeCamera& camera, const Texels& texels, const FaceMap& map, const float* offset,
               ReferenceStrip* strip);

}  // namespace tessera
