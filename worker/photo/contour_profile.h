// Where an occluding contour lies on a line of pixels across it.
#ifndef TESSERA_WORKER_PHOTO_CONTOUR_PROFILE_H_
#define TESSERA_WORKER_PHOTO_CONTOUR_PROFILE_H_

#include <array>

#include "common/imaging/border_trust.h"

namespace tessera {

// Pixels on either side of the contour as the mesh has it, from inside the nearer surface outward: pixel kReach - 1 is
// the last that shows it.
struct ContourProfile {
  static constexpr int kReach = 6;
  static constexpr int kPixels = 2 * kReach;
  std::array<double, kPixels> front_gain;  // likelihood of the class in front less that of the class behind
  std::array<double, kPixels> luminance;   // in [0, 1]
};

struct ContourMeasurement {
  double outward_px = 0;  // from the contour as the mesh has it
  double weight = 0;      // in [0, 1]; 0: nothing is to be seen
};

// The image's own edge about the place where the likelihoods go over from the class in front to the one behind, less
// what such borders are known to be off (`trust`, from front to behind, in pixels of which one of the profile's is
// 1 / `scale`). The likelihoods tell which edge is meant; where it lies, the image tells. No measurement where the
// likelihoods have no such border within reach or are not trusted; a weak one where no edge stands out.
ContourMeasurement MeasureContour(const ContourProfile& profile, const BorderTrust& trust, double scale);

}  // namespace tessera

#endif  // TESSERA_WORKER_PHOTO_CONTOUR_PROFILE_H_
