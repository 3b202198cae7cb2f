// The reference side of the data term: rows of one view with what all its pairs share.
#ifndef TESSERA_WORKER_PHOTO_REFERENCE_STRIP_H_
#define TESSERA_WORKER_PHOTO_REFERENCE_STRIP_H_

#include "common/imaging/camera.h"
#include "worker/photo/texels.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// Rows [row_begin, row_end) of a reference image with all that its pairs share. Reused from strip to strip.
struct ReferenceStrip {
  int row_begin = 0, row_end = 0;
  // By FillStrip, for the rows and 2·radius more on either side as far as there are: z of the face a pixel sees, and
  // z/h of it (h = n·(V0 - C)); 0 where the pixel is not used, in the padding too.
  PaddedPlane depth, depth_factor;
  // By SummarizeReference, radius more rows on either side: 1/weight (0: too little of the window is used), mean and
  // variance of the window about a pixel over the used pixels of the reference.
  PaddedPlane inverse_weight, mean, variance;
  // Out, by AccumulateZncc, for the rows alone.
  PaddedPlane gradient, curvature, count;

  // Sizes the planes for rows of an image; zeroes what is added to.
  void Reset(int width, int height, int radius, int new_row_begin, int new_row_end);
};

// Fills depth and depth_factor. `offset`: h of every face, as the view's centre sees it, metres. Pixels whose ray meets
// a face at a cosine of less than `min_cosine`, or from behind, and those without luminance are not used.
void FillStrip(const PinholeCamera& camera, const Texels& texels, const FaceMap& map, const float* offset,
               double min_cosine, ReferenceStrip* strip);

}  // namespace tessera

#endif  // TESSERA_WORKER_PHOTO_REFERENCE_STRIP_H_
