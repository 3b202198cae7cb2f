// Boundary F-score of label images: the accuracy of class boundaries.
#pragma once

#include <cstdint>
#include <vector>

#include "common/imaging/raster.h"

namespace tessera {

// Boundary pixels of one class in both images, and those with a boundary pixel of the other image nearby.
struct BoundaryCounts {
  int64_t result = 0, result_matched = 0;
  int64_t truth = 0, truth_matched = 0;
};

// Counts boundary pixels and matches, and adds them to `counts` (one entry per class). A pixel of class c is a boundary
// pixel of c if one of its four neighbours (inside the image, truth not 255) has another class or none. It is matched
// if the other image has a boundary pixel of c within `reach_px` (Euclidean, pixel centres). Csurka et al., "What is a
// good evaluation measure for semantic segmentation?", 2013. Both images have the same size; pixels with truth 255 are
// ignored.
void CountBoundaries(const LabelImage& result, const LabelImage& truth, int reach_px,
                     std::vector<BoundaryCounts>* counts);

// Harmonic mean of precision and recall; NaN if neither image has a boundary of the class.
double BoundaryF(const BoundaryCounts& counts);

// Mean of BoundaryF over the classes with boundary pixels in the truth; NaN if there is none.
double MeanBoundaryF(const std::vector<BoundaryCounts>& counts);

}  // namespace tessera
