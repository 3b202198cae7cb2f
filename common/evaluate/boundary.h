// Whether class boundaries lie where they should: the boundary F-score of label images.
#ifndef TESSERA_COMMON_EVALUATE_BOUNDARY_H_
#define TESSERA_COMMON_EVALUATE_BOUNDARY_H_

#include <cstdint>
#include <vector>

#include "common/imaging/raster.h"

namespace tessera {

// Boundary pixels of one class, and how many of them have one of the other image's near.
struct BoundaryCounts {
  int64_t result = 0, result_matched = 0;
  int64_t truth = 0, truth_matched = 0;
};

// A pixel of class c is a boundary pixel of c if one of its four neighbours (inside the image, truth not 255) is of
// another class or shows nothing. It is matched if the other image has a boundary pixel of c within `reach_px`
// (Euclidean, pixel centres). Csurka et al., "What is a good evaluation measure for semantic segmentation?", 2013.
// Adds to `counts`, one a class. Images of one size; pixels whose truth is 255 are left out of both.
void CountBoundaries(const LabelImage& result, const LabelImage& truth, int reach_px,
                     std::vector<BoundaryCounts>* counts);

// Harmonic mean of precision and recall; NaN if neither image has a boundary of the class.
double BoundaryF(const BoundaryCounts& counts);

// Mean of BoundaryF over the classes whose boundary the truth has; NaN if there is none.
double MeanBoundaryF(const std::vector<BoundaryCounts>& counts);

}  // namespace tessera

#endif  // TESSERA_COMMON_EVALUATE_BOUNDARY_H_
